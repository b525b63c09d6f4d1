"""The paper's study of human ability: a page to model objects in, and the comparison."""
