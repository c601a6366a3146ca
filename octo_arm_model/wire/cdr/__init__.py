"""Messages in CDR as bytes: their layout, and writers of the large ones.

May import analysis, config and core; of wire nothing but what is here.
"""
