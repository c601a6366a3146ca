"""Claims of the paper's text, and whether the numbers of each model agree with them.

May import `reproduce.cases` and the packages below reproduce; not the page.
"""
