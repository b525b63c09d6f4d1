"""Networks: linen modules whose init and apply are pure functions."""
