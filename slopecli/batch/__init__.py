"""Many pairs: handed to worker processes or a cluster, answered once each, and taken up again after a stop."""

from slopecli.batch.running import run

__all__ = ["run"]
