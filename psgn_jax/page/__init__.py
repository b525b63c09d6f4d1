"""A web page that runs a trained network in the browser: one static folder."""
