# paig from its wheel: `make wheel`, then `docker build -t paig .`; docs/python.md.
FROM python:3.12-slim-bookworm
# With it the complete torch is installed, whose GPU support is for CUDA: --build-arg TORCH='torch==2.11.*'
ARG TORCH=
COPY dist/paig-*.whl /tmp/
ENV PAIG_CACHE=/opt/paig
RUN pip install --no-cache-dir /tmp/paig-*.whl $TORCH && rm /tmp/paig-*.whl && python -m paig.libtorch
RUN useradd --create-home paig && mkdir /work && chown paig /work
USER paig
WORKDIR /work
ENTRYPOINT ["paig"]
CMD ["--help"]
