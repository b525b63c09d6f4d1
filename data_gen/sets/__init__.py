"""Training sets made of several sources by one command."""
