"""Many frames, one set of normals: they sharpen the answer, and frames that tell nothing leave no trace."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest
from frames import CAMERA, STEP, frame, true_normals
from scenery import render, to_grey, turn

from slopecli.geometry import normal_angle, solve_views
from slopecli.geometry.solver import ViewsSolution
from slopecli.look import EFFORTS, match_sift
from slopecli.options import Options
from slopecli.pipeline import sequence as run_sequence
from slopecli.sequence import Frame, Sequence, SettlingTest
from slopecli.types import FloatArray, Image

OPTIONS = Options(grid=(2, 2))


def run(*frames: FloatArray) -> Sequence:
    sequence = Sequence(CAMERA, OPTIONS)
    for one in frames:
        sequence.add(one)
    return sequence


def errors_deg(sequence: Sequence) -> FloatArray:
    return np.degrees(normal_angle(-sequence.solution().scaled_normals, true_normals()))


def sigmas_deg(solution: ViewsSolution) -> FloatArray:
    length = np.linalg.norm(solution.scaled_normals, axis=1)
    largest = np.linalg.eigvalsh(solution.normal_covariance)[:, 1]
    return np.degrees(np.sqrt(largest) / length)


def test_every_frame_sharpens_the_answer() -> None:
    sequence = run(frame(0))
    errors, sigmas = [], []
    for number in range(1, 7):
        assert sequence.add(frame(number)).status == "used"
        errors.append(np.sqrt(np.mean(errors_deg(sequence) ** 2)))
        sigmas.append(np.median(sigmas_deg(sequence.solution())))
    assert errors[-1] < 0.5 * errors[0]
    assert errors[-1] < 0.15
    assert sigmas[-1] < 0.5 * sigmas[0]


def test_positions_are_in_steps_of_the_first_move() -> None:
    sequence = run(*(frame(number) for number in range(7)))
    for number, state in enumerate(sequence.frames):
        assert state.T is not None
        np.testing.assert_allclose(state.T, STEP * number, atol=0.02 * max(number, 1))


def test_a_frame_more_costs_no_more_views() -> None:
    """Older views are summed up: those kept whole do not grow in number, and nothing is forgotten."""
    sequence = run(*(frame(number) for number in range(9)))
    assert len(sequence.solution().R) <= 6
    assert errors_deg(sequence).max() < 0.2


@cache
def undisturbed() -> Sequence:
    return run(*(frame(number) for number in range(5)))


@pytest.mark.parametrize(("last", "status"), [(72, "ok"), (260, "poor")])
def test_points_left_out_of_their_plane_widen_its_sigma(last: int, status: str) -> None:
    """Ground that stands off, such as a rock, belongs to its window; with more than a quarter of it it is no plane."""
    sequence = undisturbed()
    estimator = sequence._first.estimator  # type: ignore[union-attr]
    line, held, before = estimator.best, estimator.kept(), sigmas_deg(sequence.solution())
    rocky = np.isin(np.arange(len(line.root.q)), range(60, last))  # points of the first window
    state = line.root.state._replace(u=line.root.state.u * np.where(rocky, 1.05, 1.0))
    rock = line.root._replace(q=np.where(rocky, 0.0, line.root.q), state=state)
    estimator.restore(held._replace(lines=[replace(line, root=rock)]))
    after, report = sigmas_deg(sequence.solution()), sequence.report()
    estimator.restore(held)
    assert after[0] > 1.6 * before[0]
    assert status == "poor" or (after[1:] < 1.1 * before[1:]).all()
    assert [plane.status for plane in report.planes] == [status, "ok", "ok", "ok"]


def black(number: int) -> FloatArray:
    return np.zeros_like(frame(number))


def doubled(number: int) -> FloatArray:
    return frame(number - 1)


def doubled_with_noise(number: int) -> FloatArray:
    noise = np.random.default_rng(number).normal(0.0, 2.0, frame(0).shape)
    return to_grey(frame(number - 1) + noise)


def blurred(number: int) -> FloatArray:
    return cv2.GaussianBlur(frame(number), (0, 0), 4.0)


def blurred_by_motion(number: int) -> FloatArray:
    """Along y alone, and as noisy as any frame."""
    noise = np.random.default_rng(number).normal(0.0, 1.0, frame(0).shape)
    return to_grey(cv2.blur(frame(number), (1, 13)) + noise)


def foreign(number: int) -> FloatArray:
    rng = np.random.default_rng(number)
    return to_grey(128 + 200 * cv2.GaussianBlur(rng.standard_normal(frame(0).shape), (0, 0), 2.0))


def smaller(number: int) -> FloatArray:
    return np.ascontiguousarray(frame(number)[:200])


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (black, "dark"),
        (doubled, "repeated"),
        (doubled_with_noise, "repeated"),
        (blurred, "blurred"),
        (blurred_by_motion, "blurred"),
        (foreign, "foreign"),
        (smaller, "size"),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_a_frame_that_tells_nothing_is_said_and_leaves_no_trace(bad, why) -> None:  # type: ignore[no-untyped-def]
    disturbed = run(frame(0), frame(1), frame(2), bad(3), frame(3), frame(4))
    skipped = disturbed.frames[3]
    assert (skipped.status, skipped.why.code if skipped.why else "") == ("skipped", why)
    np.testing.assert_array_equal(disturbed.solution().scaled_normals, undisturbed().solution().scaled_normals)
    assert [note.code for note in disturbed.report().diagnostics].count("frame-skipped") == 1


def test_frames_are_found_again_after_a_gap() -> None:
    sequence = run(frame(0), frame(1), frame(2), frame(7), frame(8))
    assert [state.status for state in sequence.frames] == ["reference", *["used"] * 4]
    assert errors_deg(sequence).max() < 0.3


def test_a_large_frame_after_a_gap_is_placed_by_the_coarse_features_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their places are as fine as the small image that they were found in; the finer ones take many times as long."""
    pixels: list[float] = []

    def with_places_of_a_small_image(*arguments: Any) -> Any:
        pixels.append(arguments[2].max_pixels)
        uv1, uv2, counts = match_sift(*arguments)
        spacing = np.sqrt(arguments[0].size / pixels[-1])
        return uv1, uv2 + np.random.default_rng(0).normal(0.0, 0.4 * spacing, uv2.shape), counts

    monkeypatch.setattr("slopecli.sequence.coarse_motion.match_sift", with_places_of_a_small_image)
    names = ("width", "height", "fx", "fy", "cx", "cy")
    large = {name: 4 * getattr(CAMERA, name) + (1.5 if name in ("cx", "cy") else 0) for name in names}
    sequence = Sequence(replace(CAMERA, **large), OPTIONS)
    for number in (0, 1, 2, 7):
        sequence.add(cv2.resize(frame(number), None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC))
    found = sequence.frames[-1]
    assert found.status == "used"
    np.testing.assert_allclose(found.T, 7 * STEP, atol=0.02)
    assert len(pixels) == 1
    assert pixels[0] < EFFORTS[0].max_pixels


def test_without_parallax_there_is_no_answer_yet() -> None:
    """A camera that hovers tells nothing; the first frame that has moved does."""
    rng = np.random.default_rng(0)
    hovering = np.clip(frame(0) + rng.normal(0, 2.0, frame(0).shape), 0, 255).astype(np.uint8)
    sequence = run(frame(0), hovering)
    assert sequence.frames[1].why is not None
    assert sequence.frames[1].why.code == "parallax"
    assert not sequence.started
    assert sequence.add(frame(1)).status == "used"


def test_the_answer_is_that_of_the_solver_on_the_same_points() -> None:
    """Frame by frame gives what one solution of all views gives, within its sigma."""
    sequence = undisturbed()
    assert sequence._first is not None
    estimator = sequence._first.estimator
    points = estimator.best.points
    x = np.where(points.weight[:, None] > 0.0, points.x, np.nan).transpose(0, 2, 1)
    whole = solve_views(points.p[:2].T, x, points.plane_of_point(), relief=True, weights=points.weight)
    off = np.degrees(normal_angle(whole.scaled_normals, sequence.solution().scaled_normals))
    assert (off < 1.5 * sigmas_deg(sequence.solution())).all()


def test_verdicts_settle_only_where_they_will_stand() -> None:
    """Each of many looks is another chance to be wrong, so each takes a verdict only at its own share of the risk."""
    test = SettlingTest(4, 0.99)
    sequence = run(frame(0), frame(1))
    report = sequence.report()
    settled = dict(test.look(report))
    for plane in report.planes:
        if plane.id in settled:
            assert settled[plane.id] == plane.verdict
            assert plane.p_safe is not None
            assert min(plane.p_safe, 1.0 - plane.p_safe) <= 0.01 / (4 * 2)


def test_a_first_frame_of_other_ground_is_given_up() -> None:
    """Nothing goes with it; after a few frames that do not, the next one is the reference."""
    sequence = run(foreign(0), *(frame(number) for number in range(7)))
    assert [state.status for state in sequence.frames][-3:] == ["reference", "used", "used"]
    assert sequence.frames[0].status == "skipped"
    assert sequence.report().planes


def test_a_window_without_texture_is_rejected_and_the_others_are_answered() -> None:
    bare = [np.array(frame(number)) for number in range(4)]
    for image in bare:
        image[:130, :170] = 128
    report = run(*bare).report()
    assert [one.id for one in report.rejected] == [1]
    assert {plane.id for plane in report.planes} == {2, 3, 4}


def test_what_breaks_a_step_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = run(frame(0), frame(1), frame(2))
    before = sequence.solution().scaled_normals
    with monkeypatch.context() as broken:
        broken.setattr("slopecli.sequence.view_estimator.refine", lambda *_, **__: 1 // 0)
        assert sequence.add(frame(3)).status == "skipped"
    np.testing.assert_array_equal(sequence.solution().scaled_normals, before)
    assert sequence.add(frame(4)).status == "used"


def test_a_fault_of_the_program_is_no_foreign_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is raised, and the answer of the frames before stays."""
    sequence = run(frame(0), frame(1), frame(2))
    before = sequence.solution().scaled_normals
    with monkeypatch.context() as broken:
        broken.setattr("slopecli.sequence.view_estimator.refine", lambda *_, **__: {}["no such key"])
        with pytest.raises(KeyError):
            sequence.add(frame(3))
    np.testing.assert_array_equal(sequence.solution().scaled_normals, before)
    assert sequence.add(frame(3)).status == "used"


def plane_frames(*positions: FloatArray) -> list[FloatArray]:
    """Frames of one plane that rises by 15 degrees, from these positions, the first at the origin."""
    normal = np.array([np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0))]) / 12.0
    shown = []
    for number, position in enumerate(positions):
        R = turn(0.5 * np.sin(number), 0.3 * number, 0.4 * number)
        pair = render(R, position if number else np.array([0.0, 0.0, 1.0]), [normal], noise=1.0, noise_seed=number)
        shown.append(pair.grey2 if number else pair.grey1)
    return shown


def test_blur_is_judged_at_the_scale_of_the_reference() -> None:
    """From nearer all detail is larger, and the frame as a whole smoother: that is not blur, and what is, is told."""
    down = np.array([0.05, 0.1, 1.0])
    first, second, nearer = plane_frames(0 * down, down, 4.5 * down)
    sequence = run(first, second, cv2.GaussianBlur(nearer, (0, 0), 4.0), nearer)
    assert [state.status for state in sequence.frames] == ["reference", "used", "skipped", "used"]
    assert sequence.frames[2].why is not None
    assert sequence.frames[2].why.code == "blurred"
    np.testing.assert_array_equal(sequence.solution().R, run(first, second, nearer).solution().R)


def test_a_second_frame_that_is_blurred_begins_nothing() -> None:
    sequence = run(frame(0), blurred_by_motion(1), frame(1), frame(2))
    assert [state.status for state in sequence.frames] == ["reference", "skipped", "used", "used"]
    np.testing.assert_array_equal(sequence.solution().R, run(frame(0), frame(1), frame(2)).solution().R)


def test_a_view_off_the_line_decides_between_two_answers_for_one_plane() -> None:
    """Straight down over one plane there are two; both are told, until the camera moves aside."""
    down, aside = np.array([0.05, 0.02, 1.0]), np.array([0.0, 0.8, 0.2])
    normal = np.array([[np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0))]] * 4)
    first, *later = plane_frames(0 * down, down, 2 * down + aside)
    sequence = run(first, later[0])
    two = sequence.solution()
    assert two.status == "unresolved"
    assert two.alternative is not None
    off = [np.degrees(normal_angle(one.scaled_normals, normal)).max() for one in (two, two.alternative)]
    assert min(off) < 1.0
    assert max(off) > 5.0
    assert {plane.verdict for plane in sequence.report().planes} == {"undecided"}
    sequence.add(later[1])
    one = sequence.solution()
    assert one.status != "unresolved"
    assert np.degrees(normal_angle(one.scaled_normals, normal)).max() < 0.5


def test_errors_of_interpolation_do_not_decide_between_two_answers() -> None:
    """Of hundreds of points, a hundredth of a pixel each seems to rule out one motion: here the right one."""
    slope = np.radians(22.94)
    normal = np.array([np.sin(slope) * np.cos(3.927), np.sin(slope) * np.sin(3.927), np.cos(slope)]) / 12.0
    pair = render(turn(-0.55, -0.4, 0.747), np.array([0.994, 0.0, 0.994]), [normal], noise=1.0, noise_seed=7, seed=7)
    two = run(pair.grey1, pair.grey2).solution()
    assert two.status == "unresolved"
    assert two.alternative is not None
    off = [np.degrees(normal_angle(one.scaled_normals, normal[None])).max() for one in (two, two.alternative)]
    assert min(off) < 1.0
    assert max(off) > 30.0


def test_a_motion_that_fits_badly_is_not_taken() -> None:
    """A jump to another place and attitude is found again, or skipped; the answer does not follow a wrong motion."""
    glide, aside = np.array([0.7, 0.0, 0.7]), np.array([0.0, 0.8, 0.2])
    frames = plane_frames(0 * glide, glide, 2 * glide, 2 * glide + aside, 3 * glide + 2 * aside)
    sequence = run(*frames)
    normal = np.array([[np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0))]] * 4)
    assert np.degrees(normal_angle(sequence.solution().scaled_normals, normal)).max() < 0.5


def test_windows_are_carried_over_to_a_later_reference_with_their_ids() -> None:
    """Near the ground the first frame lacks detail: a later one takes its place, and its views sharpen the window."""
    normal = np.array([0.12, -0.08, 1.0]) / 12.0
    heights = [0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 8.5, 9.3]
    images = []
    for number, down in enumerate(heights):
        place = np.array([0.3 * np.sin(down) + 0.1 * down, 0.25 * np.cos(0.7 * down) - 0.25, down or 1.0])
        R = turn(0.5 * np.sin(number), 0.4 * np.sin(0.7 * number), number) if number else turn()
        pair = render(R, place, [normal], noise=1.0, noise_seed=number)
        images.append(Image(pair.grey2 if number else pair.grey1, path=f"{number}.png"))
    sequence = Sequence(CAMERA, Options(windows=((130, 90, 60, 60),)))
    errors, sigmas, steps = [], [], []
    for step in run_sequence([Frame(image.path, image) for image in images], sequence):
        steps.append(step)
        if step.report is not None:
            found = sequence.solution()
            errors.append(float(np.degrees(normal_angle(found.scaled_normals, normal[None]))[0]))
            sigmas.append(float(sigmas_deg(found)[0]))
    first = next(k for k, step in enumerate(steps) if step.state.later)
    assert first < len(steps) - 1
    assert all(step.report is not None and step.report.planes[0].id == 1 for step in steps[first:])
    assert max(errors[-2:]) < 0.2
    assert errors[-1] < 3.0 * sigmas[-1]
    assert sigmas[-1] < sigmas[first - 2]  # answers begin with the second frame, and this is of the one before
    answer = sequence.answer()
    assert [one.frame for one in answer.motions] == [1, *(k + 1 for k, step in enumerate(steps) if k and step.motion)]
    assert answer.report.images[1].path == f"{first - 1}.png"  # the later reference, the last that shows its points


def test_a_flight_goes_on_when_the_windows_have_left_the_view() -> None:
    """A later frame becomes the reference: motions go on in the unit of the first move, windows keep their answer."""
    normal, step = np.array([0.05, 0.02, 1.0]) / 12.0, np.array([1.1, 0.15, 0.0])
    sequence = Sequence(CAMERA, OPTIONS)
    unit = 1.0
    for number in range(15):
        R = turn(0.5 * np.sin(number), 0.4 * np.sin(0.7 * number), 0.4 * number) if number else turn()
        pair = render(R, step * max(number, 1), [normal], noise=1.0, noise_seed=number)
        before = None if not sequence.started else sequence.solution().scaled_normals
        state = sequence.add(pair.grey2 if number else pair.grey1)
        if state.T is None or state.status != "used":
            continue
        if before is None:
            unit = float(np.linalg.norm(step)) * number
        np.testing.assert_allclose(state.T * unit, step * number, atol=0.01 * np.linalg.norm(step) * number)
        assert state.R is not None
        assert np.degrees(np.linalg.norm(state.R - R)) < 0.5
    assert sequence.frames[-1].status == "used"
    assert sequence.frames[-1].later
    assert np.degrees(normal_angle(sequence.solution().scaled_normals, np.array([normal] * 4))).max() < 0.5
    report = sequence.report()
    motions = sequence.motions(report)
    assert motions[-1].frame == 15
    last_seen = [state for state in sequence.frames if state.status == "used" and not state.later][-1]
    same = next(one for one in motions if one.frame == last_seen.frame)
    np.testing.assert_allclose(same.motion.baseline_cam1, report.motion.baseline_cam1, atol=1e-9)
