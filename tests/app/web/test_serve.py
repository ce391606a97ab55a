"""Settings and addresses of the service: read as meant, or refused by the name of the setting."""

import signal
import socket
import subprocess
import sys

import httpx
import pytest

from dldsim.app.web import serve
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.ui import API_DEFAULT, api_address, client
from dldsim.errors import DldsimError


@pytest.fixture(autouse=True)
def clean(monkeypatch):
    for name in ("PORT", "HOST", "CORS_ORIGINS", "ROOT_PATH", "API"):
        monkeypatch.delenv(f"DLDSIM_WEB_{name}", raising=False)


@pytest.mark.parametrize(
    "text",
    [
        "https://lab.example, https://chips.example",
        "https://lab.example,https://chips.example/",
        " https://lab.example ,, https://chips.example,",
    ],
)
def test_origins_may_have_blanks_between_them(monkeypatch, text):
    monkeypatch.setenv("DLDSIM_WEB_CORS_ORIGINS", text)
    assert Settings.read().cors_origins == ("https://lab.example", "https://chips.example")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("PORT", "eighty", ["'eighty'", "whole number", "65535"]),
        ("PORT", "70000", ["'70000'"]),
        ("CORS_ORIGINS", "lab.example", ["such as https://lab.example", "not lab.example"]),
        ("CORS_ORIGINS", '"https://lab.example"', ["without quotes"]),
        ("CORS_ORIGINS", "https://lab.example/page", ["without path"]),
        ("HOST", "http://127.0.0.1", ["alone, without http://"]),
        ("HOST", "::1:8000x", ["::1"]),
        ("HOST", "a b", ["a name or an address"]),
        ("ROOT_PATH", "dldsim", ["begins with a slash"]),
        ("PROT", "1", ["no such setting", "Did you mean DLDSIM_WEB_PORT"]),
    ],
)
def test_a_wrong_variable_is_named(monkeypatch, name, text, words):
    monkeypatch.setenv(f"DLDSIM_WEB_{name}", text)
    with pytest.raises(DldsimError) as error:
        Settings.read()
    assert all(word in str(error.value) for word in (f"DLDSIM_WEB_{name}", *words)), error.value


def test_a_wrong_option_is_named_and_goes_over_the_variable(monkeypatch):
    monkeypatch.setenv("DLDSIM_WEB_PORT", "eighty")
    assert Settings.read({"port": 80}).port == 80
    monkeypatch.setenv("DLDSIM_WEB_PORT", "80")
    with pytest.raises(DldsimError, match="option --port = -1"):
        Settings.read({"port": -1})


@pytest.mark.parametrize(
    ("host", "bare", "url"),
    [
        ("127.0.0.1", "127.0.0.1", "http://127.0.0.1:80"),
        ("localhost", "localhost", "http://localhost:80"),
        ("0.0.0.0", "0.0.0.0", "http://127.0.0.1:80"),
        ("::1", "::1", "http://[::1]:80"),
        ("[::1]", "::1", "http://[::1]:80"),
        ("::", "::", "http://[::1]:80"),
        ("fe80::1%eth0", "fe80::1%eth0", "http://[fe80::1%25eth0]:80"),
        ("::ffff:127.0.0.1", "::ffff:127.0.0.1", "http://[::ffff:127.0.0.1]:80"),
    ],
)
def test_every_form_of_a_host_has_an_address(host, bare, url):
    assert Settings(host=host).host == bare
    assert serve.address(bare, 80) == url
    httpx.URL(url)
    assert api_address(url) == url


@pytest.mark.parametrize(
    "text",
    [
        "localhost:8000",
        "127.0.0.1:8000",
        "http://::1:8000",
        "http://",
        "ftp://host",
        "http://host:port",
        "http://host:0",
    ],
)
def test_what_is_no_address_is_named_before_the_page_starts(monkeypatch, text):
    for start in (
        lambda: serve.serve_page("127.0.0.1", 0, text),
        lambda: serve.serve_page("127.0.0.1", 0, None),
    ):
        with pytest.raises(DldsimError, match="DLDSIM_WEB_API = .*begins with http://"):
            start()
        monkeypatch.setenv("DLDSIM_WEB_API", text)
    with pytest.raises(client.ApiError, match="does not know where the service is.*WEB_API"):
        client.model(None)


def test_a_signal_to_stop_reaches_the_page(monkeypatch):
    wait = "import os, time; print(os.environ['DLDSIM_WEB_API'], flush=True); time.sleep(60)"
    serving = (
        "import sys; from dldsim.app.web import serve; "
        f"serve.page_command = lambda *_: [sys.executable, '-c', {wait!r}]; "
        "serve.serve_page('127.0.0.1', 0, 'http://127.0.0.1:9')"
    )
    page = subprocess.Popen([sys.executable, "-c", serving], stdout=subprocess.PIPE, text=True)
    assert page.stdout.readline() == "http://127.0.0.1:9\n"
    page.terminate()
    assert page.communicate(timeout=30)[0] == ""  # its pipe closes: nothing of it is left
    assert page.returncode == -signal.SIGTERM


def test_the_page_asks_where_its_variable_says(monkeypatch):
    assert api_address() == API_DEFAULT
    monkeypatch.setenv("DLDSIM_WEB_API", "https://lab.example/dldsim/")
    assert api_address() == client.address() == "https://lab.example/dldsim"
    assert api_address("http://[::1]:8000") == "http://[::1]:8000"


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_a_used_port_is_told_with_its_setting(host, tmp_path):
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as other:
        try:
            other.bind((host, 0))
        except OSError:
            pytest.skip("no IPv6 here")
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(DldsimError, match=f"port = {port} .*--port, DLDSIM_WEB_PORT"):
            serve.serve_api(Settings(host=host, port=port, state=tmp_path))
        with pytest.raises(DldsimError, match=f"port = {port} .*--page-port"):
            serve.serve_page(host, port, None)
        with pytest.raises(DldsimError, match=f"port = {port} .*--page-port"):
            serve.serve_both(Settings(host=host, port=0, state=tmp_path), port, print)
    serve.check_free(host, port, "--port")


@pytest.mark.parametrize("host", ["203.0.113.7", "no.such.host.invalid"])
def test_an_address_of_another_machine_is_told(host):
    with pytest.raises(DldsimError, match=f"host = {host} .*--host, DLDSIM_WEB_HOST"):
        serve.check_free(host, 0, "--port")


def test_the_command_tells_the_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("DLDSIM_WEB_PORT", "eighty")
    done = subprocess.run(
        [sys.executable, "-m", "dldsim", "serve", "api"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and "environment variable DLDSIM_WEB_PORT = 'eighty'" in done.stderr
