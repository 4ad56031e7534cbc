# docker build --tag subsoil .
# docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD/runs:/data/runs" subsoil run field_tine --preset coarse --out runs/first
# docker run --rm --publish 8080:8080 --volume "$PWD:/data/project" subsoil workbench project --host 0.0.0.0
FROM debian:bookworm-slim

RUN apt-get update \
 && apt-get install --yes --no-install-recommends \
      ca-certificates g++ libegl1 libgl1-mesa-dri make python3 python3-dev python3-venv \
 && rm -rf /var/lib/apt/lists/*

COPY . /opt/subsoil_ros
RUN UV_NO_CACHE=1 UV_COMPILE_BYTECODE=1 PIP_NO_CACHE_DIR=1 make -C /opt/subsoil_ros setup-extras

# Home of whoever `--user` names: kernels and logs are kept there.
RUN mkdir --mode=1777 /data
ENV PATH=/opt/subsoil_ros/.venv/bin:$PATH HOME=/data
WORKDIR /data
ENTRYPOINT ["subsoil"]
CMD ["--help"]
