# make demo      set up, build what it needs, generate the spring data, train, score
# make test      set up, run the tests, check format, lints and docs; the last line counts passed and failed tests
# make test-vector-paths  the short tests of the kernels' portable and AVX2 paths alone (part of make test)
# make lint      check format, lints and docs alone
# make build     build paig and the runners, into target/release
# make wheel     build the Python wheel (module and program) into dist
# make test-wheel  build it, install it into a fresh environment, run the demonstration, the Python tests and a notebook
# make test-studio  the page of `paig studio` in Chromium (needs Node.js and Debian's chromium; some minutes)
# make data      generate the spring data alone
# make book      the manual as a searchable book, into target/book/html (`cargo install mdbook --version 0.5.4` first)
# make libtorch  only fetch libtorch (CUDA=1: with GPU support)
# make stress    scenes unlike the paper's: datasets, runs, reports/stress (hours; goes on where it stopped)
# make baselines  other dynamics, decoders and models beside the physics: runs, reports/baselines (days; goes on)
# make ablations  the recipe without each of its parts: runs, reports/ablations (hours; goes on)
# make gallery   the equations of configs/gallery, learned from generated clips: runs, reports/gallery (an hour; goes on)
# make torture   kills, faults, fuzzing and bad calls; reports/torture (an hour; KILLS=n, FUZZ=seconds)
# make sanitize  AddressSanitizer and UndefinedBehaviorSanitizer over decoders, tracker and kernels (an hour)
# make fuzz      coverage-guided fuzzing of videos (FUZZ=seconds)
# make torture-server  the page's server under load, and killed (some minutes)
# make engines   sweeps of 200 tiny runs by GNU parallel, HyperQueue and Slurm on this machine (an hour; as root)
# make control   a pendulum that is learned from few clips is swung up by what is seen (a few minutes)
# make compare   port, PyTorch and TensorFlow side by side on fresh numbers (SEED=n)
# make bench     steps, inference, losses, fits beside PyTorch (eager, compiled) and TensorFlow, in turns; benches/
# make cost      what a step costs against batch, clip length, side, objects, threads; benches/cost
# make compare-defects   what each known defect of earlier ports does: trains with each, hours; goes on where it stopped
# make clean     remove what was built and fetched (target, dist, libtorch, compare/.venv); data and runs stay
# make help      print this
#
# Variables (make stress JOBS=4):
# JOBS           runs at a time of stress, baselines, ablations and gallery [2]
# STRESS_SEEDS   data seeds of stress [4-8,10,11]
# ABLATION_SEEDS seeds of ablations [0-2]
# GALLERY_SEEDS  seeds of gallery [0-2]

CARGO ?= cargo
PAIG := target/release/paig
PYTHON ?= python3
DEMO ?= runs/demo
DATA := data/datasets

# The profile of lints. Those of `make test` have that of its tests, and share the build scripts.
PROFILE ?= release

SEED ?= 0
JOBS ?= 2
# Stands where the references' Python environment is complete.
COMPARE_READY := compare/.venv/installed

.PHONY: demo test test-vector-paths test-studio lint format clippy documentation book libtorch build wheel test-wheel data stress baselines gallery torture engines sanitize fuzz torture-server control compare bench cost compare-defects ablations clean help

demo: libtorch
	@if [ -f $(DEMO)/config.toml ]; then resume=--resume; fi; \
	$(CARGO) run --release --quiet --package paig-runners --bin spring_color -- --generate --out $(DEMO) $$resume

# Lints come last: those that a newer compiler brings hide no test.
test: libtorch
	@CARGO="$(CARGO)" MAKE="$(MAKE)" setup/test.sh all

test-vector-paths: libtorch
	@CARGO="$(CARGO)" setup/test.sh paths

test-studio: build
	cd tests/studio && npm ci --no-fund --no-audit && npm test

lint: format clippy documentation

format:
	$(CARGO) fmt --check

clippy: libtorch
	$(CARGO) clippy --profile $(PROFILE) --workspace --all-targets -- -D warnings

documentation: libtorch
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --profile $(PROFILE) --workspace --no-deps --document-private-items

# Not part of `make test`. Any warning of mdBook ends it.
MDBOOK ?= mdbook
book:
	$(PYTHON) setup/book.py
	@log=$$($(MDBOOK) build 2>&1); status=$$?; echo "$$log"; [ $$status -eq 0 ] && ! echo "$$log" | grep -qE 'WARN|ERROR'

build: libtorch
	$(CARGO) build --release --workspace

wheel: libtorch
	@CARGO="$(CARGO)" $(PYTHON) setup/wheel.py

test-wheel: wheel
	@PYTHON="$(PYTHON)" setup/check_wheel.sh

data: build
	$(PAIG) generate --task spring_color --out $(DATA)

# Those of the report; 1-3 are for development.
STRESS_SEEDS ?= 4-8,10,11

stress: build
	$(PAIG) stress --data-seeds $(STRESS_SEEDS) --jobs $(JOBS) --no-pictures --out reports/stress

baselines: build
	$(PAIG) baselines --jobs $(JOBS) --efficiency --no-pictures --out reports/baselines

# Two tasks and two scenes of the stress suite; what is left out or changed, each alone.
ABLATED := spring_color 3bp_color configs/stress/spring_noise_10.toml configs/stress/spring_same_colour.toml
ABLATIONS := discover.guide.coverage=0 discover.guide.identity=0 discover.guide.tie=0 \
	"discover.guide.compactness=0 discover.guide.balance=0" \
	discover.start.median_background=false discover.start.sprites=false \
	"discover.start.sprites=false discover.start.template_bump=0" discover.start.mask_spread=0 \
	discover.start.localiser_scale=0 "discover.end_at_best=false join.end_at_best=false" \
	"identify.max_iterations=0 identify.recentre=false" \
	"discover.first_fit=0 identify.max_iterations=0 identify.recentre=false" identify.recentre=false join.max_steps=0 \
	"join.position_consistency=0 join.velocity_consistency=0" model.alignment_steps=0 \
	"model.refinement_steps=0 identify.velocity_steps=3000" model.names_by_continuity=false model.second_look=false
ABLATION_SEEDS ?= 0-2

ablations: build
	for task in $(ABLATED); do \
		$(PAIG) generate --task $$task --out data/ablations || exit 1; \
	done
	for variant in $(ABLATIONS); do set -- "$$@" --variant "$$variant"; done; \
	for task in $(ABLATED); do set -- "$$@" --task $$task; done; \
	$(PAIG) sweep "$$@" --seeds $(ABLATION_SEEDS) --data data/ablations \
		--out runs/ablations --jobs $(JOBS) --threads-per-run 1 || [ $$? -eq 1 ]
	$(PAIG) report runs/ablations --no-pictures --out reports/ablations

# Of the float on water no clips can be generated: it sinks with the water from the first frame on.
GALLERY := $(filter-out %/torricelli.toml,$(wildcard configs/gallery/*.toml))
GALLERY_SEEDS ?= 0-2

gallery: build
	for task in $(GALLERY); do \
		$(PAIG) generate --task $$task --out data/gallery || exit 1; \
	done
	for task in $(GALLERY); do set -- "$$@" --task $$task; done; \
	$(PAIG) sweep "$$@" --seeds $(GALLERY_SEEDS) --data data/gallery \
		--out runs/gallery --jobs $(JOBS) --threads-per-run 1 || [ $$? -eq 1 ]
	$(PAIG) report runs/gallery --no-pictures --out reports/gallery

# Each part leaves what it printed in target/torture; the last one makes the report of all. What fails stops no other part.
KILLS ?= 300
FUZZ ?= 600
STRIDE ?= 1
TORTURE := target/torture
torture: build
	mkdir -p $(TORTURE)
	-PAIG_FAULTS_STRIDE=$(STRIDE) $(CARGO) test --release --package paig-cli --test faults -- --nocapture > $(TORTURE)/faults.txt
	-$(CARGO) test --release --package paig-cli --test programs invocations -- --nocapture > $(TORTURE)/invocations.txt
	-$(CARGO) xtask fuzz $(FUZZ) > $(TORTURE)/fuzz.txt
	-$(CARGO) xtask resources 10000 > $(TORTURE)/resources.txt
	-$(CARGO) xtask torture $(KILLS) 3600 > $(TORTURE)/kills.txt
	$(CARGO) xtask torture-report

# Parts of the report of `make torture` that run on their own.
sanitize: libtorch
	mkdir -p $(TORTURE)
	CARGO="$(CARGO)" setup/sanitize.sh address | tee $(TORTURE)/sanitize.txt
	CARGO="$(CARGO)" setup/sanitize.sh kernels | tee -a $(TORTURE)/sanitize.txt

fuzz:
	CARGO="$(CARGO)" ADDRESS=1 fuzz/run.sh video $(FUZZ)

torture-server: build
	mkdir -p $(TORTURE)
	$(PYTHON) tests/server/load.py | tee $(TORTURE)/server.txt

# Needs the engines (tests/engines/engines.py says which), Slurm as root. `torture_report` shows what it prints.
ENGINES ?= parallel hyperqueue slurm
engines: build
	mkdir -p $(TORTURE)
	$(PYTHON) tests/engines/engines.py $(ENGINES) --runs 200 --kills 20 > $(TORTURE)/engines.txt

CONTROL := runs/control/clips=100

control: build
	$(PAIG) generate --task pendulum --train 100 --valid 20 --test 50 \
		--out $(DATA)/control
	@if [ -f $(CONTROL)/config.toml ]; then resume=--resume; else resume="--task pendulum \
		--config configs/control/few_clips.toml"; fi; \
	$(PAIG) train $$resume --data $(DATA)/control --out $(CONTROL)
	$(PAIG) control $(CONTROL) --planner learned,zero --episodes 20 --out $(CONTROL)/control

libtorch:
	@$(PYTHON) setup/fetch_libtorch.py $(if $(CUDA),--cuda)

$(COMPARE_READY): compare/requirements.txt
	$(PYTHON) -m venv compare/.venv
	compare/.venv/bin/python -m pip install --quiet -r compare/requirements.txt
	@touch $@

compare: build $(COMPARE_READY)
	cd compare && OMP_NUM_THREADS=1 .venv/bin/python live.py --seed $(SEED)

bench: build $(COMPARE_READY)
	cd compare && .venv/bin/python speed.py

cost: build $(COMPARE_READY)
	cd compare && .venv/bin/python cost.py

compare-defects: $(COMPARE_READY)
	cd compare && OMP_NUM_THREADS=1 .venv/bin/python -m torch_reference.defects goldens

clean:
	rm -rf target dist libtorch compare/.venv

# The lines at the head of this file.
help:
	@sed -n '/^#/!q; s/^# \{0,1\}//p' $(firstword $(MAKEFILE_LIST))
