"""Odd values, and changes of bytes, of text and of trees of names and values."""

from __future__ import annotations

import copy
import json
import math
import re
from collections.abc import Callable
from random import Random
from typing import Any

import yaml

HOSTILE = (
    "<script>alert(1)</script>",
    "=1+1",
    "\x1b[31mred\x1b]0;title\x07",
    "\u202egnp",
    "a\rb",
    "a\nb",
    "\x85\u2028",
    "\udce9",
    "é",
    "x" * 5000,
    "../../..",
    "%s{0}",
)
ODD_NUMBERS: tuple[Any, ...] = (
    *(0, -0.0, 1, -1, 0.5, 1e-9, 1e-320, 1e308, -1e308, 1e200, -1e10, 1e6, math.nan, math.inf, -math.inf),
    *(2**31, -(2**31), 2**63, 2**64, 10**400, 255, 65535, 65536),
)
ODD_VALUES: tuple[Any, ...] = (
    *ODD_NUMBERS,
    *(None, True, False, "", "x", "nan", "1e5", "0x10", "1_000", "１２", "1,5", "2030-01-01", "12:30:45", "~", "-"),
    *(
        [],
        {},
        [1],
        [[1]],
        [[1, 2], [3]],
        {"a": 1},
        [None] * 3,
        [True] * 9,
        {"rows": 3, "cols": 3, "data": []},
        ["x"] * 4,
    ),
)
ODD_TEXTS = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e308",
        "-1e308",
        "1e400",
        "-1",
        "0",
        "1e-320",
        "0x1F",
        "1_0",
        "1.",
        ".5",
        "--",
        "+-1",
        "1e",
        "null",
    ),
    *(
        "true",
        "~",
        '"',
        "'",
        "[",
        "]",
        "{",
        "}",
        ":",
        ",",
        ";",
        "#",
        "\\",
        "<",
        ">",
        "&",
        "*",
        "%",
        "\t",
        "\0",
        "\ufeff",
        "１",
        "−1",
    ),
    *(
        "9" * 400,
        "9" * 5000,
        "1" + "0" * 20,
        "2030-01-01",
        "1,5",
        "<<",
        "!!python/object:os.system",
        "&a",
        "*a",
        "---",
        "...",
    ),
)
SPECIAL_LINES = (
    *(
        "%YAML 1.1",
        "---",
        "...",
        "? [a]",
        "a: &a [*a]",
        "<<: *x",
        "- 1",
        "{}",
        "[]",
        "#",
        "\t",
        "# é",
        "=: 1",
        "'': 1",
        "null: 1",
        "yes: 1",
    ),
    *(
        "1: 2",
        "[1, 2]: 3",
        "? {a: 1}\n: 2",
        "!!set {a}",
        "!!omap [a: 1]",
        "!!binary AAAA",
        "!!timestamp x",
        "!!float x",
        "!!int ''",
    ),
    *(
        "!!bool x",
        "!!null x",
        "!<tag:yaml.org,2002:opencv-matrix> x",
        "K: !!opencv-matrix 1",
        "d: !!python/tuple {a: 1}",
    ),
    *(
        '<!DOCTYPE a [<!ENTITY b "c">]>',
        "<a>&b;</a>",
        "<![CDATA[x]]>",
        "<!-- x",
        "<?x?>",
        "</document>",
        "1 PINHOLE 4 4 1 1 1 1",
    ),
)
BYTES = (0, 1, 0x0A, 0x0D, 0x1B, 0x20, 0x22, 0x2C, 0x7F, 0x80, 0xC0, 0xFE, 0xFF)


def changed(rng: Random, data: bytes, *ways: Callable[[Random, bytes], bytes], most: int = 3) -> bytes:
    """The bytes after one to `most` of these ways of changing them."""
    for _ in range(rng.choice((1, 1, 1, 2, most))):
        data = rng.choice(ways)(rng, data)
    return data


# ---- bytes ----


def change_bytes(rng: Random, data: bytes) -> bytes:
    """Bytes flipped, set, cut, removed, doubled, moved or put in."""
    found, n = bytearray(data), len(data)
    if not n:
        return rng.randbytes(rng.randrange(64))
    at = rng.randrange(n)
    to = min(n, at + rng.choice((1, 1, 2, 4, 16, 256, 4096)))
    way = rng.randrange(9)
    if way == 0:
        for _ in range(rng.choice((1, 1, 4, 32))):
            found[rng.randrange(n)] ^= 1 << rng.randrange(8)
    elif way == 1:
        found[at:to] = bytes(rng.choice(BYTES) for _ in range(at, to))
    elif way == 2:
        del found[at:]
    elif way == 3:
        del found[at:to]
    elif way == 4:
        found[at:at] = found[at:to]
    elif way == 5:
        found[at:at] = rng.randbytes(rng.choice((1, 2, 8, 100)))
    elif way == 6:
        middle = rng.randrange(n)
        found = found[middle:] + found[:middle]
    elif way == 7:
        place = rng.randrange(min(n, 64))  # headers matter most
        width = rng.choice((1, 2, 4, 8))
        number = rng.choice((0, 1, 2**15, 2**31 - 1, 2**32 - 1, 2**64 - 1, rng.getrandbits(64)))
        found[place : place + width] = (number % 256**width).to_bytes(width, rng.choice(("little", "big")))
    else:
        found += bytes(rng.choice((1, 100, 10_000)))
    return bytes(found)


# ---- text ----


def change_text(rng: Random, data: bytes) -> bytes:
    """Numbers, words and lines replaced, removed, doubled, exchanged or put in."""
    text = data.decode("utf-8", "surrogateescape")
    way = rng.randrange(10)
    if way < 4:
        text = _with_token(rng, text, r"[-+]?\d[\w.+-]*" if way < 3 else r"[\w.]+")
    elif way == 4:
        text = _with_token(rng, text, r"[^\w\s]")
    else:
        lines = text.splitlines(keepends=True)
        text = "".join(_with_lines(rng, lines, way)) if lines else rng.choice(SPECIAL_LINES)
    return text.encode("utf-8", "surrogateescape")


def _with_token(rng: Random, text: str, pattern: str) -> str:
    tokens = list(re.finditer(pattern, text))
    if not tokens:
        return text + rng.choice(ODD_TEXTS)
    one, other = rng.choice(tokens), rng.choice(tokens)
    new = rng.choice(
        (rng.choice(ODD_TEXTS), rng.choice(ODD_TEXTS), other[0], f"-{one[0]}", f"{one[0]}e3", rng.choice(HOSTILE[:8]))
    )
    return text[: one.start()] + _text_of(new) + text[one.end() :]


def _with_lines(rng: Random, lines: list[str], way: int) -> list[str]:
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    if way == 5:
        del lines[at]
    elif way == 6:
        lines.insert(other, lines[at])
    elif way == 7:
        lines[at], lines[other] = lines[other], lines[at]
    elif way == 8:
        lines.insert(at, rng.choice(SPECIAL_LINES) + "\n")
    else:
        lines[at] = rng.choice(
            (lines[at].replace(" ", ""), f" {lines[at]}", lines[at].replace(":", "="), lines[at].upper())
        )
    return lines


def change_encoding(rng: Random, data: bytes) -> bytes:
    """Another encoding, a byte order mark, other ends of lines."""
    text = data.decode("utf-8", "replace")
    codes = ("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252", "utf-7")
    ways: tuple[Callable[[], bytes], ...] = (
        lambda: text.encode(rng.choice(codes), "replace"),
        lambda: text.encode("utf-8-sig"),
        lambda: text.replace("\n", "\r\n").encode(),
        lambda: text.replace("\n", "\r").encode(),
        lambda: text.replace("\n", " ").encode(),
        lambda: text.replace("a", "é").encode("latin-1", "replace"),
        lambda: b"\xef\xbb\xbf" * rng.randrange(3),
        lambda: text.replace(" ", "\t").encode(),
        lambda: text.replace(" ", "\u00a0").encode(),
    )
    return rng.choice(ways)()


def _text_of(text: str) -> str:
    return text.encode("utf-8", "surrogatepass").decode("utf-8", "surrogateescape")


# ---- trees ----


def parsed(text: str) -> Any:
    """The tree of a JSON or YAML text, None where it is neither."""
    try:
        return json.loads(text)
    except ValueError:
        pass
    loader: Any = type("Loader", (yaml.SafeLoader,), {})
    loader.add_multi_constructor("", lambda loader, _, node: loader.construct_mapping(node, deep=True))
    try:
        return next(iter(yaml.load_all(text.removeprefix("%YAML:1.0\n"), loader)), None)
    except (yaml.YAMLError, ValueError, TypeError):
        return None


def change_tree(rng: Random, tree: Any, vocabulary: tuple[str, ...]) -> Any:
    """A copy with one value or key changed; `vocabulary` are keys of other files."""
    tree = copy.deepcopy(tree)
    places = list(_places(tree))
    if not places:
        return rng.choice(ODD_VALUES)
    holder, key = rng.choice(places)
    way = rng.randrange(9)
    if way < 3:
        holder[key] = copy.deepcopy(rng.choice(ODD_VALUES) if rng.random() < 0.9 else rng.choice(HOSTILE))
    elif way == 3:
        holder[key] = _scaled(rng, holder[key])
    elif way == 4:
        del holder[key]
    elif way == 5:
        holder[key] = rng.choice(([holder[key]], {"data": holder[key]}, {str(key): holder[key]}, str(holder[key])))
    elif way == 6:
        other, its = rng.choice(places)
        other[its], holder[key] = copy.deepcopy(holder[key]), copy.deepcopy(other[its])
    elif isinstance(holder, dict):
        value = holder[key] if way == 7 else holder.pop(key)
        name = rng.choice(
            (rng.choice(vocabulary), str(key).upper(), f"{key}_", f"image_{key}", f"{key}1", rng.choice(HOSTILE))
        )
        holder[name] = value
    else:
        holder[key:key] = [copy.deepcopy(holder[key])] * rng.choice((1, 2, 9))
    return tree


def _places(tree: Any) -> Any:
    """(holder, key) of every value below a tree."""
    if isinstance(tree, dict | list):
        for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
            yield tree, key
            yield from _places(tree[key])


def _scaled(rng: Random, value: Any) -> Any:
    factor = rng.choice((1e-3, 1e3, -1, 0.0174533, 1e-6, 2, 0.5, 1e30, 0))
    if isinstance(value, list):
        return [_scaled(rng, one) for one in value]
    return value * factor if isinstance(value, int | float) else value


def written(rng: Random, tree: Any) -> bytes:
    """A tree as JSON or YAML."""
    try:
        text = json.dumps(tree, indent=rng.choice((None, 1)), ensure_ascii=rng.random() < 0.5)
        if rng.random() < 0.4:
            text = yaml.safe_dump(
                json.loads(text), default_flow_style=rng.choice((None, True, False)), allow_unicode=True
            )
    except (ValueError, yaml.YAMLError):
        text = repr(tree)
    return text.encode("utf-8", "surrogatepass")


def keys_of(tree: Any) -> set[str]:
    """All names in a tree."""
    return {str(key) for holder, key in _places(tree) if isinstance(holder, dict)}
