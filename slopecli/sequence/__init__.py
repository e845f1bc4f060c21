"""Many frames of one camera: windows of the first frame, tracked, with one set of normals. `Sequence` is the entry.

>>> from slopecli.sequence import Sequence
>>> sequence = Sequence(camera, options)
>>> for grey in frames:
...     state = sequence.add(grey)  # the answer so far
"""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "depth_frames": "DepthFrames",
        "frame": "Frame FrameMotion FramePrior FrameState SequenceAnswer SequenceStep",
        "frame_gates": "FrameGates",
        "known_camera": "KnownCamera",
        "settling_test": "SettlingTest",
        "stream": "Sequence",
        "tracking_tunables": "TRACKING",
    },
)
