"""Entry of the page: `streamlit run app.py`, or `python -m dldsim serve ui`."""

import numpy as np
import streamlit as st
from PIL import Image

from dldsim.app.web.ui import campaign_page, design_page, measurements_page, outcome_page, parts


def icon() -> Image.Image:
    """Posts of an array; an icon by name would be fetched from another server."""
    y, x = np.mgrid[:48, :48]
    post = ((x % 16 - 7.5) ** 2 + ((y + x // 16 * 5) % 16 - 7.5) ** 2 < 25)[..., None]
    return Image.fromarray(np.where(post, [0, 114, 178], 255).astype(np.uint8))


st.set_page_config(page_title="dldsim", page_icon=icon(), layout="wide")
page = st.navigation(
    [
        st.Page(
            design_page.page,
            title="Design",
            url_path="design",
            icon=":material/design_services:",
            default=True,
        ),
        st.Page(
            outcome_page.page, title="Outcome", url_path="outcome", icon=":material/call_split:"
        ),
        st.Page(
            campaign_page.page, title="Campaign", url_path="campaign", icon=":material/insights:"
        ),
        st.Page(
            measurements_page.page,
            title="Measurements",
            url_path="measurements",
            icon=":material/straighten:",
        ),
    ]
)
parts.survive()
parts.settle_address()
parts.sidebar()
page.run()
