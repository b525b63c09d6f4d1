"""The paper's study of human ability: a page for modelling objects, and their scores."""
