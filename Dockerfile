# The demo, then a latency measurement on JACK's dummy driver: no sound card, no robot.
#
#   docker build -t tactophone . && docker run --rm --shm-size 256m -v "$PWD/demo:/out" tactophone
#
# UNTESTED: no container can be built where this project is developed. Please report what fails.
FROM python:3.11-slim

COPY scripts/system-packages /tmp/system-packages
# The demo needs the codec and JACK; the browser is for the tests alone.
RUN PACKAGES="jackd2 libopus0 libportaudio2" /tmp/system-packages && rm -rf /var/lib/apt/lists/*

WORKDIR /tactophone
COPY pyproject.toml README.md LICENSE ./
COPY src src
RUN pip install --no-cache-dir '.[plot,sim,link,jack,portaudio,dashboard]'

# The demo needs no sound device; the latency measurement starts JACK with its dummy driver.
CMD ["sh", "-c", "tactophone demo --out /out && tactophone latency --dummy --impulses 40 --no-decisions"]
