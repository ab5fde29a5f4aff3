"""The numbers of a reference dataset: against closed-form truth, records and invariants."""
