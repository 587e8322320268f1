"""What plant and robots are told of a run: one frozen plan, resolved from a scenario once."""
