"""The node: subscriptions, publishers, services and diagnostics around a solver."""
