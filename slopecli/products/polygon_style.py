"""slopes.qml: a style of QGIS that draws the polygons of slopes.geojson as outlines in the colours of their verdicts.

QGIS takes the style whose name is that of a file. Its own would fill the polygons, and hide the map below them. Not
documented beyond the files that QGIS itself writes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from slopecli.products.drawing.marks import COLOURS

if TYPE_CHECKING:
    from slopecli.products import Answer
    from slopecli.types import Image

# colour and line of each verdict; "" of what has none
OUTLINES = {
    "safe": ("calm", "solid"),
    "undecided": ("caution", "dash"),
    "unsafe": ("hazard", "solid"),
    "": ("no answer", "solid"),
}


def encode(answer: Answer, image: Image) -> bytes:
    """Return the content of slopes.qml, which is the same for all answers."""
    return polygons_to_qml().encode("ascii")


def polygons_to_qml() -> str:
    """Write a style with a symbol a verdict: a line with a dark rim, and nothing in it."""
    categories, symbols = "", ""
    for number, (verdict, (colour, line)) in enumerate(OUTLINES.items()):
        label = verdict or "no verdict"
        categories += f'\n      <category render="true" value="{verdict}" label="{label}" symbol="{number}"/>'
        layers = _line("ink", "solid", 1.0) + _line(colour, line, 0.6)
        symbols += f'\n      <symbol type="fill" name="{number}" alpha="1">{layers}\n      </symbol>'
    return f"""<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology">
  <renderer-v2 type="categorizedSymbol" attr="verdict">
    <categories>{categories}
    </categories>
    <symbols>{symbols}
    </symbols>
  </renderer-v2>
</qgis>
"""


def _line(colour: str, style: str, width_mm: float) -> str:
    """One layer of a symbol."""
    values = {
        "line_color": ",".join(map(str, (*COLOURS[colour], 255))),
        "line_style": style,
        "line_width": f"{width_mm:g}",
        "line_width_unit": "MM",
    }
    options = "".join(f'\n            <Option type="QString" name="{k}" value="{v}"/>' for k, v in values.items())
    return (
        '\n        <layer class="SimpleLine" enabled="1" locked="0" pass="0">\n          <Option type="Map">'
        f"{options}\n          </Option>\n        </layer>"
    )
