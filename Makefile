# make demo      set up, generate the spring data, train, score
# make test      set up, check format, lints and docs, run the tests
# make libtorch  only fetch libtorch (CUDA=1: with GPU support)

CARGO ?= cargo
PYTHON ?= python3
DEMO ?= runs/demo
DATA := data/datasets

.PHONY: demo test lint libtorch build data clean

demo: data
	@if [ -f $(DEMO)/config.toml ]; then resume=--resume; fi; \
	$(CARGO) run --release --quiet --bin spring_color -- --out $(DEMO) $$resume

test: lint
	$(CARGO) test --release

lint: libtorch
	$(CARGO) fmt --check
	$(CARGO) clippy --release --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --release --no-deps --document-private-items

build: libtorch
	$(CARGO) build --release

data: build
	$(CARGO) run --release --quiet --bin generate -- --task spring_color --out $(DATA)

libtorch:
	@$(PYTHON) setup/fetch_libtorch.py $(if $(CUDA),--cuda)

clean:
	rm -rf target libtorch
