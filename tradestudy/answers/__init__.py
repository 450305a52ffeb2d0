"""The answers of a study, one file a question: each computes its answer and returns its group of results."""
