"""Training sets that combine several sources, rendered by one command."""
