"""The paper's experiments; `runner` has the common parts."""
