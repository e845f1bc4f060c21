"""Names of the files of an answer, as the rows of the products have them: a new file is added to one test."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from slopecli.products import PRODUCTS, Product


def files_of(
    products: Sequence[Product] = PRODUCTS,
    requires: Collection[str] = (),
    without: Collection[str] = (),
    also: Collection[str] = (),
) -> set[str]:
    """Files made by default of an answer that has what `requires` names; without some choices, with others."""
    there = (product for product in products if product.requires in ("", *requires))
    return {
        product.file
        for product in there
        if not product.choice or (product.by_default and product.choice not in without) or product.choice in also
    }
