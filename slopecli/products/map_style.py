"""slope_map.qml: a style of QGIS that shows the slope of slope_map.tif in the classes and colours of map.png.

QGIS takes the style whose name is that of a raster, so that it is written once beside each. Not documented beyond the
files that QGIS itself writes.
"""

from __future__ import annotations

from html import escape

from slopecli.ground.slope_map import SlopeMap
from slopecli.products.drawing.classes import slope_classes
from slopecli.types import Image


def encode(slope_map: SlopeMap, image: Image) -> bytes:
    """Return the content of slope_map.qml."""
    return map_to_qml(slope_map).encode("utf-8")


def map_to_qml(slope_map: SlopeMap) -> str:
    """Write the classes of slope as a style for the first band of slope_map.tif or slope_map_geo.tif."""
    classes = slope_classes(slope_map)
    ends = [*(f"{edge:g}" for edge in classes.edges_deg), "inf"]
    items = "\n".join(
        f'          <item alpha="255" color="#{red:02x}{green:02x}{blue:02x}" label="{escape(name)}" value="{end}"/>'
        for end, name, (red, green, blue) in zip(ends, classes.names, classes.colours.tolist(), strict=True)
    )
    return f"""<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="AllStyleCategories">
  <pipe>
    <rasterrenderer type="singlebandpseudocolor" band="1" opacity="1" alphaBand="-1" nodataColor=""
                    classificationMin="0" classificationMax="90">
      <rasterTransparency/>
      <rastershader>
        <colorrampshader colorRampType="DISCRETE" classificationMode="1" clip="0" minimumValue="0" maximumValue="90">
{items}
        </colorrampshader>
      </rastershader>
    </rasterrenderer>
    <brightnesscontrast/>
    <huesaturation/>
    <rasterresampler/>
  </pipe>
  <blendMode>0</blendMode>
</qgis>
"""
