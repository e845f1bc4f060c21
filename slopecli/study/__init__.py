"""The simulation study of the paper, section 4.1, and its figures."""
