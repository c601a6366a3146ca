"""The paper's figures, tables and claims computed by all models, and the page that shows them."""
