"""From images to clouds in files."""
