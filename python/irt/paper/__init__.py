"""The paper's experiments, figures and table again, beside its own numbers and beside other methods."""
