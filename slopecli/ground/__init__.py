"""Ground of a pair as a map: planes of footprints, their uncertainty, heights, safety and landing sites; arrays."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "cell_grid": "CellGrid choose_cells",
        "cell_map": "CellMap Demand map_cells",
        "footprint_planes": "FootprintPlanes fit_footprints heights",
        "footprints": "Cells disc_area disc_halves disc_sums",
        "map_task": "MapTask build_map sizes_of",
        "near_miss": "nearest_miss",
        "safety": "Tilts least_limit normal_cdf probability_low slope_sigma tilts",
        "slope_map": "MapInfo Site SlopeMap",
        "sites": "Ground find_sites least_around least_within safe_radii",
        "tilt_uncertainty": "Root across_step gradient_parts largest_jump normal_covariance normals_under wholly_shown",
        "window_planes": "WindowPlanes fit_windows",
    },
)
