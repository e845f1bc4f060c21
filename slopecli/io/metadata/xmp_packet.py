"""The values of an XMP packet by namespace and name, read as a stream: nothing in it is expanded, fetched or nested.

Source: ISO 16684-1. A value is an attribute of rdf:Description or the text of an element; of lists and structures the
texts of their innermost elements are found, which no property read here is.
"""

from __future__ import annotations

from xml.parsers import expat

Name = tuple[str, str]  # namespace, local name

BETWEEN = "\x1f"  # between a namespace and a name; no URI has it


class _Refused(Exception):
    """The packet declares a document type, with which entities can be defined, or values without end."""


def xmp_values(packet: bytes, most_bytes: int = 1_000_000) -> tuple[dict[Name, str], str]:
    """The values of a packet, and what is wrong with it, "" for nothing; what stands before the damage is kept.

    most_bytes : packets of cameras have a few thousand; longer ones hold pictures.
    """
    if len(packet) > most_bytes:
        return {}, f"has {len(packet)} bytes, at most {most_bytes} are read"
    values: dict[Name, str] = {}
    try:
        _parser(values).Parse(packet.strip(b"\0 \t\r\n"), True)
    except _Refused:
        return {}, "declares a document type, which no XMP does"
    except (expat.ExpatError, ValueError, LookupError) as error:
        return values, f"is damaged ({' '.join(str(error).split())[:80]})"
    return values, ""


def _parser(values: dict[Name, str]) -> expat.XMLParserType:
    """A parser that puts the values of what it reads into a dictionary."""
    parser = expat.ParserCreate(namespace_separator=BETWEEN)
    parser.buffer_text = True
    element, texts = ("", ""), list[str]()

    def start(tag: str, attributes: dict[str, str]) -> None:
        """Note the element that begins, and take its attributes."""
        nonlocal element
        element = _name(tag)
        texts.clear()
        for key, value in attributes.items():
            values.setdefault(_name(key), value.strip())

    def end(tag: str) -> None:
        """Take the text of the element that ends."""
        nonlocal element
        text = "".join(texts).strip()
        if text and _name(tag) == element:
            values.setdefault(element, text)
        element = ("", "")
        texts.clear()

    def refuse(*_: object) -> None:
        raise _Refused

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = texts.append
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    return parser


def _name(expanded: str) -> Name:
    namespace, _, local = expanded.rpartition(BETWEEN)
    return namespace, local
