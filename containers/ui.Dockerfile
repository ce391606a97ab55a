# The page, a client of the API. Build from the root of the repository:
#   docker build -f containers/ui.Dockerfile -t dldsim-ui .
ARG BASE=python:3.11.13-slim-bookworm

FROM ${BASE} AS build
WORKDIR /src
COPY pyproject.toml requirements.txt requirements-web.txt README.md LICENSE ./
COPY dldsim ./dldsim
RUN python -m venv /opt/dldsim && \
    /opt/dldsim/bin/pip install --no-cache-dir -r requirements-web.txt && \
    /opt/dldsim/bin/pip install --no-cache-dir .

FROM ${BASE}
COPY --from=build /opt/dldsim /opt/dldsim
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin dldsim
ENV PATH=/opt/dldsim/bin:$PATH PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1 \
    HOME=/tmp DLDSIM_WEB_HOST=0.0.0.0 DLDSIM_WEB_API=http://api:8000
WORKDIR /tmp
EXPOSE 8501
USER 10001
HEALTHCHECK --interval=30s --timeout=10s --start-period=60s --retries=3 \
    CMD ["python", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8501/_stcore/health', timeout=8)"]
CMD ["python", "-m", "dldsim", "serve", "ui", "--api", "http://api:8000"]
