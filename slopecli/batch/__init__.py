"""Many pairs: found, handed to worker processes or a cluster, answered once each, and taken up again after a stop."""
