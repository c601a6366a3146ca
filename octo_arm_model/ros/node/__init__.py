"""The node of an arm: subscriptions, publishers, services and diagnostics around a solver."""
