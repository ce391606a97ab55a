"""The page of the service: a Streamlit application that is a client of /api/v1 and nothing else."""

from pathlib import Path

API_VARIABLE = "DLDSIM_WEB_API"
"""Environment variable with the address of the API; the default is that of `serve api`."""
API_DEFAULT = "http://127.0.0.1:8000"
SCRIPT = Path(__file__).with_name("app.py")
"""What `streamlit run` is given; its options are in `.streamlit/config.toml` beside it."""
