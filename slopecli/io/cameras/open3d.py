"""Open3D's camera_intrinsic.json and PinholeCameraParameters: a matrix listed column by column."""

from __future__ import annotations

from collections.abc import Mapping

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera


def find(content: CameraFileContent) -> dict[str, values.Tree]:
    """The camera; {} for another format, also for a matrix of another program, which is listed row by row."""
    tree = content.tree
    inner = tree.get("intrinsic")
    if isinstance(inner, Mapping) and str(tree.get("class_name", "")).startswith("Pinhole"):
        return {"": inner}
    matrix = tree.get("intrinsic_matrix")
    if not isinstance(matrix, list) or len(matrix) != 9 or "width" not in tree:
        return {}
    by_rows = all(isinstance(value, int | float) for value in matrix) and matrix[6:8] == [0, 0] and matrix[2] != 0
    return {} if by_rows and "class_name" not in tree else {"": tree}


def read(tree: values.Tree, image: values.Size | None) -> Camera:
    """Pinhole cameras; pixel centres at integers."""
    values.refuse_unread_distortion(tree, (), "Open3D's pinhole cameras have no distortion")
    numbers = values.numbers(tree.get("intrinsic_matrix"), "intrinsic_matrix")
    if len(numbers) != 9:
        raise InputError(f"intrinsic_matrix has {len(numbers)} numbers, needed 9, column by column")
    if numbers[6:8] == [0, 0] and numbers[2:6:3] != [0, 0]:
        raise InputError(
            "intrinsic_matrix is listed row by row; Open3D lists it column by column: fx 0 0 0 fy 0 cx cy 1"
        )
    columns = [numbers[k::3] for k in range(3)]
    own = values.size_of(tree.get("width"), tree.get("height"))
    intrinsics = values.intrinsics_of_matrix(columns, "intrinsic_matrix")
    return values.make_camera("Open3D", own or image, intrinsics, size_given=own is not None)
