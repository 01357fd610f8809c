# Two stages: the first builds the wheel with the page in it, the second runs it as nobody in particular.
# `docker run -p 8080:8080 IMAGE` prints a link with the token; -e GCS_TOKEN=… sets it.
FROM python:3.12-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends make && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY . .
RUN make wheel

FROM python:3.12-slim-bookworm
COPY --from=build /src/dist/*.whl /tmp/
RUN pip install --no-cache-dir /tmp/*.whl && rm /tmp/*.whl \
 && useradd --create-home --uid 10001 gcs && mkdir /data && chown gcs /data
USER gcs
# The simulator's compiled loops, into the user's cache: a container then starts as fast as without them.
RUN python -c 'import vehicle_sim.server'
ENV GCS_HOST=0.0.0.0 GCS_PORT=8080 GCS_DATA=/data GCS_LINKS=udpin://0.0.0.0:14550
VOLUME /data
EXPOSE 8080 14550/udp
HEALTHCHECK --interval=10s --timeout=3s --start-period=15s \
  CMD ["python", "-c", "import http.client as h; c = h.HTTPConnection('127.0.0.1', 8080, timeout=2); c.request('GET', '/api/v1/health'); raise SystemExit(c.getresponse().status not in (200, 401))"]
ENTRYPOINT ["gcs"]
CMD ["serve"]
