"""The blocks of the page of the reproduction, and their HTML.

May import all of reproduce; only `cli` imports it.
"""
