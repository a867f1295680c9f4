"""The table of contacts: contacts.csv and contacts.parquet."""
