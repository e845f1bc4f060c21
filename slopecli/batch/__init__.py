"""Many pairs: estimated in worker processes or on a cluster, one folder a pair; a stopped batch can be continued."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "answer": "answer_jobs load_inputs",
        "jobs": "TRANSIENT Answer Job Keep Pair Progress Shipped failure fingerprint_of finished store",
        "pairs": "FoundPairs find_pairs safe_name",
        "records": "Outcome read_outcome record_of",
        "running": "run",
        "scheduler": "answer_here run_batch",
        "slopecli.options": "CameraChoice",
        "summary": "COLUMNS index_html results_jsonl summary_csv",
        "worker": "Limits Worker WorkerCrashed WorkerTimeout",
    },
)
