"""report.html: complete, escaped, the same each time, and nothing but itself; then what a browser makes of it."""

from __future__ import annotations

import base64
import gzip
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command import slopemap
from map_factory import make_map
from report_factory import make_ambiguity, make_camera, make_image, make_region_labels, make_region_report, make_report

from slopecli.products import Origin
from slopecli.products.page import cheapest_remedy, encode, encode_map, seen_from_1
from slopecli.report import plane_kinds
from slopecli.types import Diagnostic, Image, Report

CAUSES = {"matches": 0.3, "relief": 0.0, "gaps": 0.4, "motion": 0.0, "up": 0.0, "camera": 0.0}
IMAGE, SMALL = make_image(), make_image(320, 240, colour=True)
REGIONS = make_region_report(make_camera(320, 240), make_region_labels(320, 240))
ORIGIN = Origin(IMAGE, "slopemap estimate first.png second.png --report", ("camera: converted from metres",))


def with_causes(report: Report) -> Report:
    return replace(report, planes=tuple(replace(one, slope_sigma_causes_deg=CAUSES) for one in report.planes))


def text_of(page: bytes) -> str:
    """What is left without scripts, styles and data."""
    text = re.sub(r"<(script|style)\b.*?</\1>", "", page.decode(), flags=re.DOTALL)
    return re.sub(r'"data:[^"]*"', '""', text).replace("&nbsp;", " ")


@pytest.fixture(scope="module")
def page() -> bytes:
    return encode(with_causes(make_report()), IMAGE, ORIGIN)


def test_the_page_says_what_the_answer_is_and_why(page: bytes) -> None:
    text = " ".join(re.sub(r"<[^>]*>", " ", text_of(page)).split())
    for said in (
        "4 of 8 windows safe",
        "29.0 ± 0.9° (6)",
        "tolerance 15°",
        "matches 36 %, gaps 64 %",
        "median parallax 3.1 px",
        "take a longer baseline",
        "camera: converted from metres",
        "slopemap estimate first.png second.png --report",
        f"sha256 {'0' * 64}",
        "window 9: low-texture",
        "Limits",
    ):
        assert said in text, said


def test_nothing_is_loaded_and_all_but_pictures_is_small(page: bytes) -> None:
    outside = re.sub(rb'"data:image/[^"]*"', b'""', page)
    assert not re.search(rb'(?:src|href|action)=["\']?(?!data:|"")[a-z]*:?//', outside)
    assert b"default-src 'none'" in page
    for content in (page, encode(REGIONS, SMALL, Origin(SMALL)), encode_map(some_map(), IMAGE, ORIGIN)):
        assert len(re.sub(rb'"data:image/[^"]*"', b'""', content)) < 1_000_000
    assert encode(with_causes(make_report()), IMAGE, ORIGIN) == page


def test_the_page_tells_slopes_in_the_unit_asked_for(page: bytes) -> None:
    report = with_causes(make_report())
    for unit, tolerance, slope in (
        ("percent", "26.8 %", "55.4 ± 2.1 %"),
        ("x-in-12", "3.22 in 12", "6.65 ± 0.25 in 12"),
    ):
        text = text_of(encode(replace(report, options={**report.options, "slope_unit": unit}), IMAGE, ORIGIN))
        for said in (
            f"Against a tolerance of {tolerance}, ",
            f"</span>tolerance {tolerance}",
            f"-{tolerance}</li>",
            slope,
        ):
            assert said in text, said
        assert "tolerance 15" not in text
    assert "29.0 ± 0.9°" in text_of(page)


def test_planes_that_were_found_are_named() -> None:
    text = text_of(encode(REGIONS, SMALL, Origin(SMALL)))
    titles = re.findall(r'<th scope="col"[^>]*><button[^>]*>([^<]*)<', text)
    assert titles[:4] == ["id", "what", "image", "slope"]
    row = re.search(r'<tr><td class="number"[^>]*>(\d+)</td><td class=""[^>]*>(\w+|-)</td><td[^>]*>([\d.]+) %', text)
    kind = plane_kinds(REGIONS)[int(row[1])] or "-"
    assert row[2] == kind
    assert "what" not in re.findall(r"<button[^>]*>([^<]*)<", text_of(encode(make_report(), IMAGE, ORIGIN)))


def some_map() -> Any:
    slope = np.random.default_rng(5).uniform(0.0, 40.0, (60, 80))
    slope[:, :10] = np.nan
    return make_map(slope, 0.4, report=make_report())


def test_names_and_texts_are_escaped() -> None:
    evil = '<script>alert("x")</script>\u202e\x07&'
    info = replace(make_report().images[0], path=evil)
    report = make_report(images=(info, info), diagnostics=(Diagnostic("low-parallax", "warning", evil, 1.0, evil),))
    camera = replace(make_camera(), source=evil, note=evil)
    text = encode(replace(report, cameras=(camera, camera)), IMAGE, Origin(IMAGE, evil, (evil,))).decode()
    assert "<script>alert" not in text
    assert text.count("&lt;script&gt;alert") >= 7
    assert "\u202e" not in text
    assert "\x07" not in text


def test_two_answers_are_as_large_as_each_other() -> None:
    report = make_report()
    text = text_of(encode(replace(report, ambiguity=make_ambiguity(report)), IMAGE))
    first, second = re.findall(r'<section class="answer (\w+)">\s*<h2>([^<]*)</h2>', text)
    assert (first[1], second[1]) == ("First answer", "Second answer")
    assert first[0] == second[0]
    assert "Two answers fit the images equally well" in text
    assert "a third image, or a known altitude" in text
    assert "or slope" in text


def test_rows_without_an_image_have_a_page_too(tmp_path: Path) -> None:
    uv = np.random.default_rng(1).uniform(50, 600, (60, 2))
    ray = (uv - 320.0) / 600.0
    moved = np.column_stack([ray, np.ones(60)]) - np.array([0.2, 0.0, 0.1]) * (0.2 + 0.02 * ray[:, :1])
    rows = np.column_stack([uv, moved[:, :2] / moved[:, 2:] * 600.0 + 320.0])
    matches = tmp_path / "matches.csv"
    matches.write_text("x1,y1,x2,y2\n" + "\n".join(",".join(f"{value:.4f}" for value in row) for row in rows))
    camera = ("--intrinsics", "600,600,320,320", "--noise", "0.1")
    done = slopemap("solve", str(matches), *camera, "-o", str(tmp_path / "out"), "--report")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "report.html").read_bytes()
    assert b"Why each sigma" in page
    assert b"data:image" not in page


def test_the_cheapest_remedy_is_not_that_of_a_cause_that_hardly_matters() -> None:
    assert cheapest_remedy({**CAUSES, "up": 0.25}) == "up"
    assert cheapest_remedy({**CAUSES, "up": 0.15}) == "gaps"
    assert cheapest_remedy(dict.fromkeys(CAUSES, 0.0)) in CAUSES


def decoded(address: str) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(base64.b64decode(address.partition(",")[2]), np.uint8), cv2.IMREAD_GRAYSCALE)


def test_image_2_looks_like_image_1_under_the_true_plane_and_not_under_another() -> None:
    report = make_report(polygons=[np.array([[0, 0], [640, 0], [640, 480], [0, 480]], float)])
    (plane,) = report.planes
    # image 2 by the homography of the plane, whose motion is that of the report
    motion = report.motion
    K = report.cameras[0].K
    T, N = motion.baseline_cam1, -plane.normal_cam1 / plane.distance
    H = K @ (np.eye(3) - np.outer(T, N)) @ np.linalg.inv(K)
    image2 = Image(cv2.warpPerspective(IMAGE.grey, H, (640, 480)))
    other = replace(report, planes=(replace(plane, distance=2.0 * plane.distance),))
    differences = []
    for one in (report, other):
        first, second = (decoded(address) for address in seen_from_1(one, IMAGE, image2))
        middle = np.s_[300:600, 400:800]
        differences.append(np.abs(first[middle].astype(float) - second[middle]).mean())
    assert differences[0] < 8 < 15 < differences[1]


SAMPLE = Path(__file__).parent.parent / "sample_data" / "descent"


@pytest.mark.parametrize("command", ["estimate", pytest.param("map", marks=pytest.mark.slow)])
def test_the_command_writes_a_page_on_request_the_same_each_time(tmp_path: Path, command: str) -> None:
    pair = []
    for name in ("image1.png", "image2.png"):
        small = cv2.resize(cv2.imread(str(SAMPLE / name)), (240, 240), interpolation=cv2.INTER_AREA)
        pair.append(str(tmp_path / name))
        cv2.imwrite(pair[-1], small)
    arguments = (command, *pair, "--fov", "60", "-o", str(tmp_path / "out"), "--report")
    pages = []
    for _ in range(2):
        done = slopemap(*arguments)
        assert done.returncode == 0, done.stderr
        pages.append((tmp_path / "out" / "report.html").read_bytes())
    assert pages[0] == pages[1]
    text = pages[0].decode()
    assert "slopemap " + " ".join(arguments) in text
    for part in ("flicker", "model", "planes", "why"):
        assert f'<section id="{part}">' in text
    assert "camera" in text[text.index('<section id="why">') :]  # a focal length that is known to 3 % only


# ---- in a browser ----


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    selenium = pytest.importorskip("selenium.webdriver", reason="no selenium")
    found = [shutil.which(name) for name in ("chromium", "chromedriver")]
    if None in found:
        pytest.skip("no chromium with chromedriver")
    from selenium.webdriver.chrome.service import Service

    options = selenium.ChromeOptions()
    options.binary_location = found[0]
    for flag in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "window-size=1200,900", "no-first-run",
                 "use-angle=swiftshader", "enable-unsafe-swiftshader"):  # fmt: skip
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = selenium.Chrome(options=options, service=Service(found[1]))
    yield driver
    driver.quit()


def ids(browser: Any) -> list[str]:
    return [row.text.split()[0] for row in browser.find_elements("css selector", "#planes tbody tr")]


def wait_for_the_model(browser: Any) -> float:
    """Until the model's frame shows anything, at most a minute; returns the mean grey of what it shows."""
    from selenium.webdriver.support.ui import WebDriverWait

    browser.execute_script("document.querySelector('#model').scrollIntoView()")

    def picture(driver: Any) -> np.ndarray:
        place = driver.find_element("css selector", "#model .model")
        shown = cv2.imdecode(np.frombuffer(place.screenshot_as_png, np.uint8), cv2.IMREAD_GRAYSCALE)
        framed = driver.find_elements("css selector", "#model iframe")
        return shown[20:-20, 20:-20] if framed else np.zeros((1, 1))

    WebDriverWait(browser, 60).until(lambda driver: picture(driver).std() > 12)
    shown = picture(browser)
    return float(shown[shown != shown[0, 0]].mean())


@pytest.mark.parametrize(
    "kind", ["windows", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("regions", "map"))]
)
def test_a_browser_shows_it_sorts_it_and_asks_nobody(browser: Any, tmp_path: Path, kind: str) -> None:
    contents = {
        "windows": lambda: encode(with_causes(make_report()), IMAGE, ORIGIN),
        "regions": lambda: encode(REGIONS, SMALL, Origin(SMALL)),
        "map": lambda: encode_map(some_map(), IMAGE, ORIGIN),
    }
    (tmp_path / "report.html").write_bytes(contents[kind]())
    browser.get((tmp_path / "report.html").as_uri())
    before = ids(browser)
    headers = browser.find_elements("css selector", "#planes thead button")
    at = [header.text for header in headers].index("slope")
    headers[at].click()
    slopes = browser.execute_script(
        f"return [...document.querySelectorAll('#planes tbody tr')].map(r => Number(r.cells[{at}].dataset.value))"
    )
    assert slopes == sorted(slopes)
    headers[at].click()
    assert ids(browser) != before
    headers[0].click()
    assert ids(browser) == before
    browser.find_element("css selector", "#flicker button").click()
    seen = cv2.cvtColor(SMALL.colour, cv2.COLOR_BGR2GRAY)[REGIONS.labels > 0] if kind == "regions" else IMAGE.grey
    assert wait_for_the_model(browser) == pytest.approx(seen.mean(), rel=0.2)  # as light as the image
    wide = browser.execute_script("return document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert wide <= 0
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    log = str(browser.get_log("performance")).replace("\\", "")
    asked = re.findall(r'"Network\.requestWillBeSent".*?"url":"(\w+):', log)
    assert "file" in asked
    assert set(asked) <= {"file", "about", "data", "blob"}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_phone_in_either_scheme(browser: Any, tmp_path: Path, page: bytes, scheme: str) -> None:
    (tmp_path / "report.html").write_bytes(page)
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    phone = {"width": 360, "height": 740, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", phone)
    try:
        browser.get((tmp_path / "report.html").as_uri())
        wide = browser.execute_script("return document.documentElement.scrollWidth")
        right = browser.execute_script(
            "return Math.max(...[...document.querySelectorAll('.why td')].map(td => td.getBoundingClientRect().right))"
        )
        body = browser.find_element("css selector", "body")
        colours = (body.value_of_css_property(name) for name in ("color", "background-color"))
        ink, paper = (sum(map(int, re.findall(r"\d+", colour)[:3])) for colour in colours)
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert max(wide, right) <= 360
    assert abs(ink - paper) > 500
    assert (paper > ink) == (scheme == "light")


def test_the_viewer_is_that_of_trimesh_and_packed_without_a_date(page: bytes) -> None:
    packed = re.search(rb'class="packed">([^<]*)<', page)
    assert packed is not None
    content = base64.b64decode(packed[1])
    assert content[4:8] == bytes(4)
    assert b"TrackballControls" in gzip.decompress(content)
