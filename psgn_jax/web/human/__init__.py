"""The paper's study of human ability: a page to model objects, and the scores of the models."""
