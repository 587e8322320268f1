"""Running a scenario, in one process or in many."""
