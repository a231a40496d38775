"""Put a table into a page, between `<!-- NAME begins -->` and `<!-- NAME ends -->`."""


def pasted(page: str, name: str, tables: str) -> str:
    """Return the page with the tables; raise ValueError if it has no place for them."""
    begin, end = f"<!-- {name} begins -->", f"<!-- {name} ends -->"
    before, found, rest = page.partition(begin)
    _, ended, after = rest.partition(end)
    if not (found and ended):
        raise ValueError(f"the page has no place between '{begin}' and '{end}'")
    return f"{before}{begin}\n{tables.strip()}\n{end}{after}"
