# Two commands do everything: `make demo` and `make test`.
# .venv gets what is missing; the stamps in it remember what has been installed.
PYTHON ?= python3
BAG ?= bags/wine_glass
CAMERA ?=
SCENE ?=
FORCE ?=
BIN := .venv/bin
RUN := .venv/.installed-run
TEST := .venv/.installed-test
DOCS := .venv/.installed-docs
ARM := .venv/.installed-manipulate
OLDEST := .venv-oldest/.installed
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --no-compile
# Workers share the cores: threads of BLAS, OpenCV and Mesa would wait for each other, and spin.
ONE_THREAD := OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 LP_NUM_THREADS=1

# Byte code is kept: else every process compiles all sources anew, those of the tests too.
unexport PYTHONDONTWRITEBYTECODE

# Slow tests that lean on numpy, scipy and OpenCV: run with the oldest of these too.
OLDEST_TOO := $(addprefix test/, evidence/test_contour_net.py lightfield/calibration/test_hand_eye.py \
	lightfield/calibration/test_fixed_board.py runtime/test_start.py pmcl/test_second_search.py \
	pmcl/prior/test_orientation.py profiles/test_measure.py \
	lightfield/calibration/test_intrinsics.py::test_exact_corners_give_the_camera \
	lightfield/calibration/test_bent_board.py::test_in_pictures \
	lightfield/test_exchanged_pictures.py::test_they_are_told_and_others_are_not[True-angles0])

.PHONY: demo test test-quick test-tensorflow test-oldest kernels lint venv docs eval bench soak fuzz learned clean

# FORCE=--force: overwrite pictures in out/ that an earlier run did not write.
# SCENE=sink: a simulated arm takes a glass out of water, through the same nodes.
ifeq ($(SCENE),)
demo: $(RUN)
	@$(BIN)/python -m pmcl_ros.nodes.demo --bag $(BAG) --camera '$(CAMERA)' --out out $(FORCE)
else
demo: $(ARM)
	@$(BIN)/pmcl warm-up
	@$(BIN)/pmcl manipulate $(SCENE) --trials 1 --seed 1 --out out/$(SCENE) $(FORCE)
endif

# The kernels are compiled while the packages of the tests, which change no others, are installed.
test: $(RUN)
	@$(MAKE) --no-print-directory -j 2 kernels lint test-tensorflow
	$(ONE_THREAD) $(BIN)/python -m pytest -n 5 --dist loadfile --no-loadscope-reorder

kernels: $(RUN)
	@$(BIN)/pmcl warm-up --all

# Apart from the others: test/conftest.py says why.
test-tensorflow: $(TEST)
	$(BIN)/python -m pytest -m tensorflow

# What needs no ROS graph, no long search and no study: SLOW in test/conftest.py lists the rest.
test-quick: $(TEST)
	@$(BIN)/pmcl warm-up
	$(ONE_THREAD) $(BIN)/python -m pytest -n 3 --dist loadfile -m 'not slow'

# The same with each package as old as requirements.txt allows, in an environment of its own.
test-oldest: $(OLDEST)
	@.venv-oldest/bin/pmcl warm-up
	$(ONE_THREAD) .venv-oldest/bin/python -m pytest -n 3 --dist loadfile -m 'not slow'
	$(ONE_THREAD) .venv-oldest/bin/python -m pytest -n 3 --dist loadfile $(OLDEST_TOO)

lint: $(TEST)
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

venv: $(TEST)

# The lists of topics and parameters from the code, then the site, in out/site.
docs: $(DOCS)
	$(BIN)/python -m pmcl_ros.nodes.reference > docs/reference.md
	$(BIN)/python -m pmcl_ros.nodes.reference --parameters > config/pmcl.yaml
	$(BIN)/mkdocs build --strict

# Errors over a folder of captures with truth (docs/howto/evaluation.md): make eval CAPTURES=DIR
eval: $(RUN)
	$(BIN)/pmcl evaluate $(CAPTURES) --calibration config/cameras/demo.yaml --trials 5 --out out

# Times of the stages beside their plain forms: make bench NAME=dlv
NAME ?= decode
bench: $(RUN)
	$(BIN)/pmcl bench $(NAME)

# Captures through the whole graph: in one process, in several, and disturbed. Fails when one is lost
# unnoticed, or something grows. Disks are filled where mounts of its own can be made. QUICK=--quick:
# small volumes.
CAPTURES_SOAKED ?= 2000
QUICK ?=
SOAK = $(BIN)/python -m pmcl_ros.evaluation.bench.soak --captures $(CAPTURES_SOAKED) $(QUICK) $(FORCE)
DISKS = $(shell unshare --mount true 2>/dev/null && echo --full-disks)
soak: $(RUN)
	$(SOAK) --out out/soak/one_process
	$(SOAK) --processes --out out/soak/processes
	@[ -n "$(DISKS)" ] || echo 'disks are not filled: that takes unshare (util-linux) and root'
	$(SOAK) --processes --disturbances 48 $(DISKS) --out out/soak/disturbed

# Damaged files of every format that is read: FUZZED of them, the same for the same SEED
FUZZED ?= 12000
SEED ?= 0
fuzz: $(TEST)
	PMCL_FUZZ_INPUTS=$(FUZZED) $(BIN)/python -m pytest test/test_fuzz.py --hypothesis-seed=$(SEED)

# All of config/learned again, from seeds, into out/learned (docs/developing.md): hours. PART=1000: a
# trial. JOBS=8: processes that render.
learned: $(TEST)
	@$(MAKE) --no-print-directory -f tools/learned.mk PYTHON=$(BIN)/python

# Debian packages, then ROS and the run-time wheels; says how long that took.
$(RUN): requirements.txt requirements-ros.txt setup.py setup.cfg
	@PYTHON=$(PYTHON) tools/system.sh
	@start=$$(date +%s) && echo 'installing ROS 2 and the Python packages into .venv ...' && \
	$(PYTHON) -m venv .venv && $(PIP) -r requirements.txt -r requirements-ros.txt && \
	$(PIP) --no-deps --editable . && touch $@ && \
	echo "installed in $$(( $$(date +%s) - start )) s"

$(TEST): requirements-test.txt requirements-docs.txt requirements-simulate.txt \
		requirements-manipulate.txt $(RUN)
	@echo 'installing the test packages ...' && $(PIP) -r requirements-test.txt && touch $@

$(ARM): requirements-manipulate.txt $(RUN)
	@$(PIP) -r requirements-manipulate.txt && touch $@

# The tools of the tests are the newest that go with these; training and the site need none here.
$(OLDEST): requirements.txt requirements-ros.txt requirements-test.txt setup.py setup.cfg
	@PYTHON=$(PYTHON) tools/system.sh
	@echo 'installing the oldest packages into .venv-oldest ...' && \
	$(PYTHON) -m venv .venv-oldest && sed 's/>=\(.*\)/==\1.*/' requirements.txt > .venv-oldest/oldest.txt && \
	grep -Ev '^(#|-r|tensorflow|mypy|ruff|import-linter|distributed|colcon)' requirements-test.txt > \
		.venv-oldest/test.txt && \
	.venv-oldest/bin/python -m pip --disable-pip-version-check install --quiet --no-compile \
		-r .venv-oldest/oldest.txt -r requirements-ros.txt -r .venv-oldest/test.txt && \
	.venv-oldest/bin/python -m pip --disable-pip-version-check install --quiet --no-deps \
		--editable . && touch $@

$(DOCS): requirements-docs.txt $(RUN)
	@$(PIP) -r requirements-docs.txt && touch $@

clean:
	rm -rf .venv .venv-oldest out build install log
