"""Answer jobs in this process: read the inputs, answer, store the files. Every failure of a pair is an outcome."""

from __future__ import annotations

import hashlib
import math
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath

from slopecli.batch.jobs import Answer, Job, Outcome, Shipped, camera_file, failure, fingerprint_of, finished, store
from slopecli.errors import InputError, NoAnswer, SlopemapError
from slopecli.ground.slope_map import SlopeMap
from slopecli.io.cameras.reading import camera_for, read_camera_file
from slopecli.io.frame_sources import read_frames
from slopecli.io.images import decode_image, read_image_file
from slopecli.io.metadata.applied import apply_metadata
from slopecli.io.metadata.image_metadata import Metadata
from slopecli.io.metadata.metadata_reading import decode_metadata
from slopecli.io.metadata.of_frames import options_of_frames
from slopecli.look.features import FeatureMemory
from slopecli.options import CameraChoice, Options
from slopecli.pipeline import estimate, sequence, sequence_answer, slope_map
from slopecli.products import MAP_PRODUCTS, SEQUENCE_PRODUCTS, Origin, encode_products
from slopecli.sequence.stream import Sequence as Runner
from slopecli.types import Camera, Image, Report


def answer_jobs(jobs: Sequence[Job]) -> list[Answer]:
    """Answer jobs one after the other.

    Raises
    ------
    DiskFull : there is no space left. Earlier answers are stored.
    """
    return [answer(job) for job in jobs]


def answer(job: Job) -> Answer:
    """Answer one pair, or return the outcome of an earlier run that has finished it."""
    try:
        inputs = job.shipped or load_inputs(job)
        if isinstance(inputs, Answer):
            return inputs
        outcome, contents = _solve(job, inputs)
        return Answer(store(job, outcome, contents)) if job.shipped is None else Answer(outcome, contents=contents)
    except SlopemapError:
        raise
    except Exception as error:  # while reading or storing; `_solve` handles those of the estimate
        return Answer(store(job, _unexpected(job, error), {}))


def load_inputs(job: Job) -> Shipped | Answer:
    """The bytes of the input files of a job; or its answer, if it is finished or they cannot be read."""
    if job.pair.problem is not None:
        return _unreadable(job, job.pair.problem)
    files: dict[str, bytes] = {}
    try:
        for path, choice in _sides(job):
            files |= _read(path, choice, job.base)
        # the frames of a sequence are read one by one again, as together they may not fit into memory
        frames = {path: _digest(read_image_file(path, job.base)) for path in job.pair.frames}
    except InputError as error:
        # a second look names both images; it finds no problem if this one was temporary
        return _unreadable(job, "; ".join(_problems(job)) or str(error))
    digests = {path: _digest(content) for path, content in files.items()}
    fingerprint = fingerprint_of(job, digests | frames)
    known = finished(job, fingerprint)
    return Shipped(files, fingerprint) if known is None else Answer(known, kept=True)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _sides(job: Job) -> list[tuple[str, CameraChoice]]:
    """Path and camera of the first and of the second image; of a sequence of the first alone."""
    pair, none = job.pair, CameraChoice()
    if pair.frames:
        return [(pair.image1, pair.camera1 or none)]
    return [(pair.image1, pair.camera1 or none), (pair.image2, pair.camera2 or none)]


def _read(path: str, choice: CameraChoice, base: str) -> dict[str, bytes]:
    """The bytes of an image and of its camera file, by path."""
    files, (camera, _) = {path: read_image_file(path, base)}, camera_file(choice, base)
    return files if camera is None else {camera: read_camera_file(camera, base), **files}


def _problems(job: Job, files: Mapping[str, bytes] | None = None) -> list[str]:
    """Messages about the inputs of both images, so that both can be repaired before the next run."""
    found: dict[str, None] = {}
    for path, choice in _sides(job):
        try:
            _load(path, choice, _read(path, choice, job.base) if files is None else files)
        except InputError as error:
            found[str(error)] = None
    return list(found)


def _load(path: str, choice: CameraChoice, files: Mapping[str, bytes]) -> tuple[Image, Camera]:
    image = _memory.image(files[path], path)
    return image, camera_for(image, choice, files)[0]


def _unreadable(job: Job, message: str) -> Answer:
    return Answer(store(job, failure(job, 1, "unreadable", message), {}))


def _solve(job: Job, inputs: Shipped) -> tuple[Outcome, dict[str, bytes]]:
    """The outcome of a pair and its files; no files without an answer."""
    try:
        return _estimate(job, inputs)
    except NoAnswer as error:
        outcome = failure(job, error.exit_code, error.code, error.reason, error.remedy)
    except SlopemapError as error:
        outcome = failure(job, error.exit_code, "input" if error.exit_code == 1 else "degenerate", str(error))
    except Exception as error:
        outcome = _unexpected(job, error)
    return replace(outcome, fingerprint=inputs.fingerprint), {}


def _unexpected(job: Job, error: Exception) -> Outcome:
    """The outcome after an unexpected exception: out of memory, or a bug."""
    import cv2

    # found by Python or NumPy, by OpenCV, or by C++
    no_memory = isinstance(error, MemoryError) or getattr(error, "code", None) == cv2.Error.StsNoMem
    if no_memory or "bad_alloc" in str(error):
        _memory.clear()
        remedy = "raise --memory or lower --jobs, or try smaller images"
        return failure(job, 1, "memory", "not enough memory for images of this size", remedy)
    found = f"unexpected {type(error).__name__}: {' '.join(str(error).split())}"
    return failure(job, 1, "unexpected", found, "this is a fault of slopemap")


def _estimate(job: Job, inputs: Shipped) -> tuple[Outcome, dict[str, bytes]]:
    try:
        loaded = [_load(path, choice, inputs.files) for path, choice in _sides(job)]
    except InputError:
        raise InputError("; ".join(_problems(job, inputs.files))) from None
    if job.pair.frames:
        return _follow(job, job.options, loaded[0][1], inputs.fingerprint)
    (image1, camera1), (image2, camera2) = loaded
    options = _options(job, inputs.files)
    if job.wanted is not None:
        pair = image1, image2, camera1, camera2
        ground = slope_map(*pair, options, job.wanted, memory=_memory.features)
        contents = encode_products(ground, image1, job.keep, MAP_PRODUCTS, Origin(image2))
        return _outcome_of_map(job, ground, inputs.fingerprint, tuple(contents)), contents
    report = estimate(image1, image2, camera1, camera2, options, memory=_memory.features)
    contents = encode_products(report, image1, job.keep, origin=Origin(image2))
    return _outcome_of(job, report, inputs.fingerprint, tuple(contents)), contents


def _follow(job: Job, options: Options, camera: Camera, fingerprint: str) -> tuple[Outcome, dict[str, bytes]]:
    """The outcome of a sequence and its files."""
    runner, at_end = Runner(camera, options, keep_depth=True), None
    if job.metadata is not None:

        def read(path: str) -> Metadata:
            return decode_metadata(read_image_file(path, job.base), path)

        (_, choice) = _sides(job)[0]
        runner.options_of, at_end = options_of_frames(read, job.metadata, options, choice)
    for _ in sequence(read_frames(job.pair.frames, job.base), runner):
        pass
    runner.options_of = at_end
    answer = sequence_answer(runner)
    image = runner.images[0]
    contents = encode_products(answer, image, job.keep, SEQUENCE_PRODUCTS) if isinstance(image, Image) else {}
    return _outcome_of(job, answer.report, fingerprint, tuple(contents)), contents


def _options(job: Job, files: Mapping[str, bytes]) -> Options:
    """The options of a job, with what the metadata of its images state."""
    if job.metadata is None:
        return job.options
    both = (decode_metadata(files[path], path) for path in (job.pair.image1, job.pair.image2))
    first, second = both
    (_, one), (_, two) = _sides(job)
    return apply_metadata((first, second), job.metadata, job.options, (one, two))


def _outcome_of(job: Job, report: Report, fingerprint: str, files: tuple[str, ...]) -> Outcome:
    planes, pair = report.planes, job.pair
    verdicts = Counter(plane.verdict for plane in planes)
    (slope, sigma), (other_slope, other_sigma) = _steepest(report)
    return Outcome(
        name=pair.name,
        image1=pair.image1,
        image2=pair.image2,
        exit_status=0,
        fingerprint=fingerprint,
        files=files,
        n_planes=len(planes),
        n_ok=sum(plane.status == "ok" for plane in planes),
        n_safe=verdicts["safe"],
        n_unsafe=verdicts["unsafe"],
        n_undecided=verdicts["undecided"],
        n_rejected=len(report.rejected),
        steepest_deg=slope,
        steepest_sigma_deg=sigma,
        steepest_other_deg=other_slope,
        steepest_other_sigma_deg=other_sigma,
        ambiguity=report.ambiguity.status,
        noise_px=_rounded(report.fit.noise_px),
        diagnostics=tuple(diagnostic.code for diagnostic in report.diagnostics),
    )


def _outcome_of_map(job: Job, ground: SlopeMap, fingerprint: str, files: tuple[str, ...]) -> Outcome:
    share = ground.area_share
    outcome = replace(
        _outcome_of(job, ground.report, fingerprint, files),
        safe_share=_rounded(share["safe"]),
        unsafe_share=_rounded(share["unsafe"]),
        undecided_share=_rounded(share["undecided"]),
        unknown_share=_rounded(share["unknown"]),
        n_sites=len(ground.sites),
    )
    if not ground.sites:
        return outcome
    largest = max(ground.sites, key=lambda site: site.radius_px)
    return replace(
        outcome,
        site_radius_px=_rounded(largest.radius_px),
        site_radius=_rounded(largest.radius),
        site_slope_deg=_rounded(largest.slope_deg),
        site_slope_sigma_deg=_rounded(largest.slope_sigma_deg),
    )


def _steepest(report: Report) -> list[tuple[float | None, float | None]]:
    """Slope and sigma, deg, of the steepest plane of status ok: in the root where it is steeper, then in the other."""
    others = report.ambiguity.others
    firsts = [plane for plane in report.planes if plane.status == "ok"]
    seconds = [others[plane.id] for plane in firsts if plane.id in others and others[plane.id].slope_known]
    measured = [[plane for plane in root if not plane.taken_as_level] for root in (firsts, seconds)]
    slopes = [[(plane.slope_deg, plane.slope_sigma_deg or 0.0) for plane in root] for root in measured]
    steepest = sorted((max(root) for root in slopes if root), reverse=True)
    found = [(_rounded(slope), _rounded(sigma)) for slope, sigma in steepest]
    return [*found, (None, None), (None, None)][:2]


def _rounded(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None


class _Memory(threading.local):
    """Decoded images and features of the last pairs of this thread."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        self.features = FeatureMemory(2)
        self._images: dict[tuple[str, str], Image] = {}  # by SHA-256 and suffix, the last used at the end

    def image(self, content: bytes, path: str) -> Image:
        """Decode the bytes of an image file, unless it is among the last ones."""
        key = (hashlib.sha256(content).hexdigest(), PurePath(path).suffix)
        image = self._images.pop(key, None)
        self._images[key] = decode_image(content, path) if image is None else replace(image, path=path)
        while len(self._images) > 2:  # neighbouring pairs share one
            del self._images[next(iter(self._images))]
        return self._images[key]


_memory = _Memory()
