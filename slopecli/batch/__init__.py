"""Many pairs: handed to worker processes or a cluster, answered once each, and taken up again after a stop."""

from slopecli.batch.running import run

__all__ = ["run"]

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "answer": "answer_jobs load_inputs",
        "engine": "run_batch",
        "jobs": "Answer CameraChoice Job Keep Outcome Pair Progress Shipped",
        "ledger": "TRANSIENT failure fingerprint_of finished store",
        "pairs": "FoundPairs find_pairs safe_name",
        "remote": "answer_here",
        "worker": "Limits Worker WorkerCrashed WorkerTimeout",
    },
)
