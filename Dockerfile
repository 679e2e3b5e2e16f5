# `docker build --target runtime .` runs the first command of the README and adds all extras; a development container,
# the second one.
FROM python:3.11-slim AS base
# A graphics driver in software, for `symaware replay --screenshot`; git, for development.
RUN apt-get update && apt-get install -y --no-install-recommends git mesa-vulkan-drivers && rm -rf /var/lib/apt/lists/*
WORKDIR /symaware

FROM base AS runtime
COPY . .
RUN python3 -m venv .venv && .venv/bin/pip install -c constraints.txt '.[plot]' && .venv/bin/symaware run scenarios/hello.yaml && .venv/bin/symaware plot hello.mcap
RUN .venv/bin/pip install -c constraints.txt '.[all]' ./plugins/symaware-mujoco
ENV PATH="/symaware/.venv/bin:$PATH"
WORKDIR /work
ENTRYPOINT ["symaware"]
CMD ["--help"]
