# The API with the campaign that comes with the package. Build from the root of the repository:
#   docker build -f containers/api.Dockerfile -t dldsim-api .
# For a base that cannot change: --build-arg BASE=python@sha256:...
ARG BASE=python:3.11.13-slim-bookworm

FROM ${BASE} AS build
WORKDIR /src
COPY pyproject.toml requirements.txt requirements-web.txt README.md LICENSE ./
COPY dldsim ./dldsim
RUN python -m venv /opt/dldsim && \
    /opt/dldsim/bin/pip install --no-cache-dir . fastapi uvicorn python-multipart

FROM ${BASE}
COPY --from=build /opt/dldsim /opt/dldsim
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin dldsim && \
    install -d -o 10001 -g 10001 /state
# the root file system may be read-only: everything written goes to /state and /tmp
ENV PATH=/opt/dldsim/bin:$PATH PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1 \
    HOME=/tmp XDG_CACHE_HOME=/tmp/cache MPLCONFIGDIR=/tmp/matplotlib \
    DLDSIM_WEB_HOST=0.0.0.0 DLDSIM_WEB_PORT=8000 DLDSIM_WEB_STATE=/state
WORKDIR /state
VOLUME /state
EXPOSE 8000
USER 10001
HEALTHCHECK --interval=30s --timeout=10s --start-period=60s --retries=3 \
    CMD ["python", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8000/api/v1/health', timeout=8)"]
CMD ["python", "-m", "dldsim", "serve", "api"]
