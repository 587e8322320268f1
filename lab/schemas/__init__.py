"""JSON Schemas and reference pages, made from the models: of scenarios and of verdicts."""
