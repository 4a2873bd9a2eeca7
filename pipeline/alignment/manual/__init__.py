"""The pose by hand.

In: a pose and a user action (a key, a drag, a pick). Out: the new pose, or the landmark that the pick belongs to.
"""
