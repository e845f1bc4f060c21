"""nerfstudio cameras."""

from pathlib import Path

from camera_factory import NERFSTUDIO, check_is_the_sample, refusal, write

from slopecli.io.cameras import load_camera


def test_nerfstudio_fisheye_and_per_frame_cameras(tmp_path: Path) -> None:
    fisheye = {**NERFSTUDIO, "camera_model": "OPENCV_FISHEYE", "k3": 0.1, "k4": 0.2, "p1": 0, "p2": 0}
    assert load_camera(write(tmp_path, fisheye)).distortion == (-0.28, 0.074, 0.1, 0.2)
    shared = {key: value for key, value in NERFSTUDIO.items() if key not in ("fl_x", "frames")}
    frames = [{"file_path": f"images/{name}.jpg", "fl_x": focal} for name, focal in (("a", 800), ("b", 900))]
    path = write(tmp_path, {**shared, "frames": frames})
    check_is_the_sample(load_camera(f"{path}#a.jpg"))
    assert load_camera(f"{path}#b.jpg").fx == 900


def test_nerfstudio_terms_we_lack_are_refused(tmp_path: Path) -> None:
    assert "k4 = 0.1" in refusal(write(tmp_path, {**NERFSTUDIO, "k4": 0.1}))
    assert "'EQUIRECTANGULAR'" in refusal(write(tmp_path, {**NERFSTUDIO, "camera_model": "EQUIRECTANGULAR"}))
