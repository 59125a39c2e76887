# The page; behind it any other command:
#   docker build -t mavhums .
#   docker run -p 127.0.0.1:8080:8080 -v mavhums:/data mavhums    # then open http://127.0.0.1:8080/?token=…
#   docker run -v mavhums:/data -v "$PWD/logs:/logs:ro" --no-healthcheck mavhums fleet watch /logs
FROM python:3.12 AS build
WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY mavhums mavhums
COPY sim sim
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.12-slim
COPY constraints.txt /install/
COPY --from=build /wheel /install
RUN for wheel in /install/*.whl; do \
        pip install --no-cache-dir --no-compile -c /install/constraints.txt "$wheel[fleet,serve,viewer,zstd]" || exit 1; \
    done && \
    rm -r /install && \
    useradd --create-home --uid 1000 mavhums && install -d -o mavhums /data
USER mavhums
WORKDIR /data
ENV MAVHUMS_STORE=/data/flights.sqlite
VOLUME /data
EXPOSE 8080
# Without its token the page answers 401: it lives.
HEALTHCHECK --interval=30s --timeout=5s --start-period=30s CMD ["python", "-c", "import http.client as h; c = h.HTTPConnection('127.0.0.1', 8080, timeout=4); c.request('GET', '/api/version'); raise SystemExit(c.getresponse().status != 401)"]
ENTRYPOINT ["mavhums"]
CMD ["serve", "--host", "0.0.0.0", "--store", "/data/flights.sqlite"]
