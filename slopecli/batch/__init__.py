"""Many pairs: estimated in worker processes or on a cluster, one folder a pair; a stopped batch can be continued."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "answer": "answer_jobs load_inputs",
        "jobs": "Answer CameraChoice Job Keep Outcome Pair Progress Shipped",
        "page": "index_html",
        "pairs": "FoundPairs find_pairs safe_name",
        "records": "TRANSIENT failure fingerprint_of finished store",
        "remote": "answer_here",
        "running": "run",
        "scheduler": "run_batch",
        "summary": "COLUMNS results_jsonl summary_csv",
        "worker": "Limits Worker WorkerCrashed WorkerTimeout",
    },
)
