"""Clients of the node of an arm: read its topics, command its tendons, and swap its arm."""
