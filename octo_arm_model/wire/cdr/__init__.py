"""Messages in CDR as bytes: their layout, and writers of the large ones.

May import analysis, config and arm; of wire nothing but what is here.
"""
