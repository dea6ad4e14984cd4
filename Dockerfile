# The demo, then a latency measurement on JACK's dummy driver: no sound card, no robot.
#
#   docker build -t tactophone . && docker run --rm --shm-size 256m -v "$PWD/demo:/out" tactophone
#
# For x86-64; not built for arm64. Built with buildah and run, in Debian 13 with Python 3.11 and no real-time rights, with
# 256 and with 64 MB of shared memory: the demo's scores, then 40 of 40 impulses. That base stood in for Docker Hub's, and
# no Docker was there.
FROM python:3.11-slim

WORKDIR /tactophone
COPY scripts/system-packages scripts/system-packages
# The demo needs the codec and JACK; the browser is for the tests alone.
RUN scripts/system-packages jackd2 libopus0 libportaudio2 && rm -rf /var/lib/apt/lists/*

COPY requirements/lock.txt requirements/lock.txt
COPY packages packages
# The lock's versions; of its packages only those that these extras need.
RUN pip install --no-cache-dir --constraint requirements/lock.txt './packages/tactophone[plot,link,jack,portaudio,dashboard]' './packages/tactophone-lab[sim]'

# By its number, a cluster can tell that this is not root.
RUN useradd --create-home --uid 1000 tactophone && install -d -o tactophone /out
USER 1000

# The demo needs no sound device; the latency measurement starts JACK with its dummy driver.
CMD ["sh", "-c", "tactophone demo --out /out && tactophone latency --dummy --impulses 40 --no-decisions"]
