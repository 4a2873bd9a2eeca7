"""Panel *Set up*: open a case, or its parts in any order."""
