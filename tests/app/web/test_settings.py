"""Settings of the service, what it needs, and its containers."""

import ast
import re
from pathlib import Path

import pytest

from dldsim.app import cli
from dldsim.app.web import serve
from dldsim.app.web.api.settings import Settings


def test_settings_come_from_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("DLDSIM_WEB_WORKERS", "3")
    monkeypatch.setenv("DLDSIM_WEB_CORS_ORIGINS", "https://a.example,https://b.example")
    found = Settings.read({"port": 81})
    assert (found.workers, found.port, len(found.cors_origins)) == (3, 81, 2)
    assert Settings(state=tmp_path).cors_origins == () and Settings().host == "127.0.0.1"


def others(package):
    """Modules outside of the service."""
    found = [p for p in package.rglob("*.py") if package / "app" / "web" not in p.parents]
    assert found
    return found


def test_only_serve_imports_the_service():
    package = Path(cli.__file__).parents[1]
    for path in others(package):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module]
        if any(n.startswith("dldsim.app.web") for n in names):
            assert path.name == "service.py"


def test_a_missing_extra_is_told():
    with pytest.raises(serve.DldsimError, match="requirements-web.txt"):
        serve._need("a_package_that_is_not_there")


def test_containers_are_closed():
    root = Path(cli.__file__).parents[2]
    for name in ("api", "ui"):
        text = (root / "containers" / f"{name}.Dockerfile").read_text()
        assert re.search(r"^FROM \$\{?BASE", text, re.M) and "HEALTHCHECK" in text
        assert re.search(r"^ARG BASE=python:\d+\.\d+\.\d+-slim-\w+$", text, re.M)
        assert text.rindex("\nUSER 10001") < text.index("\nCMD")
    import yaml

    services = yaml.safe_load((root / "compose.yaml").read_text())["services"]
    assert set(services) == {"api", "ui"}
    for service in services.values():
        assert service["read_only"] is True and service["cap_drop"] == ["ALL"]
        assert "no-new-privileges:true" in service["security_opt"]
        assert "environment" in service and "healthcheck" not in service  # that of the image
        assert all(port.startswith("127.0.0.1:") for port in service.get("ports", []))
