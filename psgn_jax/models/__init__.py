"""Networks, as linen modules."""
