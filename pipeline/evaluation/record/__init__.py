"""In: the scores of an evaluation. Out: its record, its tables, notes on what they mean, and its pictures."""
