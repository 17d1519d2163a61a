# make demo      set up, generate the spring data, train, score
# make test      set up, check format, lints and docs, run the tests
# make libtorch  only fetch libtorch (CUDA=1: with GPU support)
# make stress    scenes unlike the paper's: datasets, runs, reports/stress (hours; goes on where it stopped)
# make compare   port, PyTorch and TensorFlow side by side on fresh numbers (SEED=n)
# make bench     training steps and inference beside PyTorch's, eager and compiled, in turns; benches/
# make compare-defects   what each known defect of earlier ports does: trains with each, hours; goes on where it stopped

CARGO ?= cargo
PYTHON ?= python3
DEMO ?= runs/demo
DATA := data/datasets

SEED ?= 0
JOBS ?= 2
COMPARE_PYTHON := compare/.venv/bin/python

.PHONY: demo test lint libtorch build data stress compare bench compare-defects clean

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

stress: build
	$(CARGO) run --release --quiet --bin stress -- --jobs $(JOBS)

libtorch:
	@$(PYTHON) setup/fetch_libtorch.py $(if $(CUDA),--cuda)

$(COMPARE_PYTHON): compare/requirements.txt
	$(PYTHON) -m venv compare/.venv
	$@ -m pip install --quiet -r compare/requirements.txt
	@touch $@

compare: build $(COMPARE_PYTHON)
	cd compare && OMP_NUM_THREADS=1 .venv/bin/python live.py --seed $(SEED)

bench: build $(COMPARE_PYTHON)
	cd compare && .venv/bin/python speed.py

compare-defects: $(COMPARE_PYTHON)
	cd compare && OMP_NUM_THREADS=1 .venv/bin/python -m torch_reference.defects goldens

clean:
	rm -rf target libtorch compare/.venv
