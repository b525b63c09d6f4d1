"""A static web page that runs a trained network in the browser."""
