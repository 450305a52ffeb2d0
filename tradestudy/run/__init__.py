"""A study computed: one results group after another."""
