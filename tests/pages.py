"""What several tests read in pages of HTML."""

import re


def cells(page):
    """[[HTML of a cell]] of the tables of a page."""
    rows = re.findall(r"<tr\b.*?</tr>", page, re.S)
    return [re.findall(r"<t[dh]\b[^>]*>(.*?)</t[dh]>", row, re.S) for row in rows]
