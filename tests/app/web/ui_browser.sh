#!/bin/sh
# Install Debian's chromium if it is missing, and drive the page with it. Arguments go to pytest.
set -eu
cd "$(dirname "$0")/../../.."
python=${PYTHON:-python3}
if ! command -v chromium > /dev/null; then
    apt-get update && apt-get install --yes --no-install-recommends chromium
fi
$python -c 'import playwright' 2> /dev/null || $python -m pip install --quiet playwright
exec $python -m pytest -m service tests/app/web/ui_browser.py -s "$@"
