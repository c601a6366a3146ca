"""The paper's figures, tables and claims computed by all models, and the page that shows them.

May import simulation and what is below it; of its own, page imports figures, tables and claims.
"""
