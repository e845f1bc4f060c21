"""From a Report to the bytes of each output file; one file a format."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "glb": "LARGEST_TEXTURE_PX model_from_camera1 report_to_glb",
        "overlay": "draw_overlay",
        "ply": "plane_mesh report_to_ply triangulate",
        "region_mesh": "MOST_TRIANGLES region_grid region_surfaces",
        "slopes_json": "report_to_json",
        "steps": "draw_steps",
    },
)
