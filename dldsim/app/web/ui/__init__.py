"""The page of the service: a Streamlit application that is a client of /api/v1 and nothing else."""

import os
from pathlib import Path
from urllib.parse import urlsplit

API_VARIABLE = "DLDSIM_WEB_API"
"""Environment variable with the address of the API; the default is that of `serve api`."""
API_DEFAULT = "http://127.0.0.1:8000"
SCRIPT = Path(__file__).with_name("app.py")
"""What `streamlit run` is given; its options are in `.streamlit/config.toml` beside it."""


def api_address(given: str | None = None) -> str:
    """Where the API is: as given, else by API_VARIABLE, else API_DEFAULT.

    Raises ValueError that says what an address is.
    """
    found = given or os.environ.get(API_VARIABLE) or API_DEFAULT
    try:
        parts = urlsplit(found.strip())
        good = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # brackets or port
        good = False
    if not good or parts.query or parts.fragment:
        raise ValueError(
            f"--api or {API_VARIABLE} = {found!r}: an address begins with http:// or https://, "
            "with IPv6 in brackets, such as http://127.0.0.1:8000 or http://[::1]:8000."
        )
    return found.strip().rstrip("/")
