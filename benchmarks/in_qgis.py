"""Open a folder of results in QGIS without a screen, say what it finds, and draw what it shows.

    QT_QPA_PLATFORM=offscreen /usr/bin/python3 benchmarks/in_qgis.py FOLDER PICTURE.png

Needs the Python of QGIS (Debian: python3-qgis, qgis-providers). Ends with an error if QGIS reads the projection, names
of bands, what is not known, or the style otherwise than meant.
"""

from __future__ import annotations

import sys
from pathlib import Path

from qgis.core import (
    QgsApplication,
    QgsCoordinateTransform,
    QgsMapRendererSequentialJob,
    QgsMapSettings,
    QgsProject,
    QgsRasterLayer,
    QgsRenderContext,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize


def check(ok: object, what: str) -> None:
    """Say what was looked at; end if it is not as meant."""
    print(f"{'ok' if ok else 'WRONG'}: {what}")
    if not ok:
        sys.exit(1)


def main(folder: Path, picture: Path) -> None:
    """Check the GeoTIFF, its style and the polygons, and draw them."""
    raster = QgsRasterLayer(str(folder / "slope_map_geo.tif"), "slope")
    polygons = QgsVectorLayer(str(folder / "slopes.geojson"), "planes and sites", "ogr")
    check(raster.isValid() and polygons.isValid(), "both files open")
    crs = raster.crs()
    check(crs.authid().startswith("EPSG:32"), f"projection {crs.authid()} {crs.description()}")
    check("slope_deg" in raster.bandName(1), f"{raster.bandCount()} bands, the first {raster.bandName(1)}")
    check(raster.dataProvider().sourceNoDataValue(1) == -9999, "nodata is -9999")
    renderer = raster.renderer()
    check(renderer.type() == "singlebandpseudocolor", "slope_map_geo.qml is taken by itself")
    items = renderer.shader().rasterShaderFunction().colorRampItemList()
    check(len(items) > 1, f"classes {', '.join(item.label for item in items)}")
    check(polygons.crs().authid() in ("EPSG:4326", "OGC:CRS84"), f"polygons in {polygons.crs().authid()}")
    check(polygons.featureCount() > 0, f"{polygons.featureCount()} polygons: {', '.join(polygons.fields().names())}")
    over = QgsCoordinateTransform(polygons.crs(), crs, QgsProject.instance()).transformBoundingBox(polygons.extent())
    check(over.intersects(raster.extent()), "polygons lie on the raster")
    outlines = polygons.renderer()
    check(outlines.type() == "categorizedSymbol", "slopes.qml is taken by itself")
    kinds = {layer.layerType() for symbol in outlines.symbols(QgsRenderContext()) for layer in symbol.symbolLayers()}
    check(kinds == {"SimpleLine"}, "polygons are outlines, and hide nothing")
    settings = QgsMapSettings()
    settings.setLayers([polygons, raster])
    settings.setDestinationCrs(crs)
    settings.setExtent(raster.extent())
    settings.setOutputSize(QSize(1000, 1000))
    job = QgsMapRendererSequentialJob(settings)
    job.start()
    job.waitForFinished()
    check(job.renderedImage().save(str(picture)), f"drew {picture}")


if __name__ == "__main__":
    application = QgsApplication([], False)
    application.initQgis()
    main(Path(sys.argv[1]), Path(sys.argv[2]))
    application.exitQgis()
