# How all of config/learned is made from seeds: `make learned` writes the same files into OUT. Each
# is a target, there when all of it is done: make goes on where it was stopped, and so do the
# commands. docs/developing.md says how they are taken over.
SHELL := bash
.SHELLFLAGS := -o pipefail -ec
.DELETE_ON_ERROR:
.PHONY: all

PYTHON ?= python3
PMCL = $(PYTHON) -m pmcl_ros.cli
JOBS ?= 1
# PART=1000: a trial, on the thousandth part of scenes, pictures and steps.
PART ?= 1
OUT ?= out/learned$(if $(TRIAL),_part_$(PART))
TRIAL := $(filter-out 1,$(PART))
FILES := contour.yaml creases.yaml contour_map.onnx contour_map.yaml contour_map_evidence.yaml \
	views.yaml
# Searches read what has been learned here, not what is shipped.
export PMCL_LEARNED := $(OUT)

# part: of a number, in a trial at least so many. scenes: COUNT,SEED,OPTIONS into a folder beside the
# target.
LEAST := 2
part = $(if $(TRIAL),$(shell echo $$(( $(1) / $(PART) > $(2) ? $(1) / $(PART) : $(2) ))),$(1))
scenes = $(PMCL) scenes render --count $(call part,$(1),$(LEAST)) --seed $(2) $(3) --jobs $(JOBS) -o $(@:.yaml=)
learn = $(PMCL) learn $(@:.yaml=) --seed 0 $(1) --jobs $(JOBS) --force --out $@ | tee -a $(@:.yaml=.log)
ARC := --camera $(OUT)/camera.yaml --samples 3 --cameras arc:5:60
GRID := --camera $(OUT)/camera.yaml --samples 3 --cameras grid:3x3:0.1

all: $(OUT)/record.txt

$(OUT)/contour.yaml: LEAST := 8
$(OUT)/contour.yaml:
	$(call scenes,45,20000,--views 5 --samples 1)
	$(call learn,--views 5)

$(OUT)/creases.yaml:
	$(call scenes,2,30000,--views 5 --samples 1 --kind 'opaque block' --kind 'glass block')
	$(call scenes,48,30002,--views 5 --samples 1 --kind 'opaque block' --kind 'glass block' \
		--kind 'opaque block' --kind 'glass block film')
	$(call learn,--views 5 --creases)

# The last that learn-map writes is contour_map.yaml. A network that was trained for minutes finds
# nothing: that of a trial begins with the shipped one.
$(OUT)/contour_map.onnx: $(OUT)/contour_map.yaml ;
$(OUT)/contour_map.yaml:
	$(PMCL) scenes pictures --count $(call part,3084,20) --first-seed 0 --jobs $(JOBS) -o $(OUT)/pictures
	$(PMCL) learn-map $(OUT)/pictures --steps $(call part,40000,50) --seed 0 --batch 8 --crop 192 --bfloat16 \
		$(if $(TRIAL),--start config/learned/contour_map.onnx --rate 0.0001) -o $(OUT) | tee -a $(@:.yaml=.log)

$(OUT)/camera.yaml:
	mkdir -p $(OUT)
	echo '{width: 640, height: 480, fx: 600, cx: 322, cy: 238}' > $@

$(OUT)/contour_map_evidence.yaml: $(addprefix $(OUT)/,contour.yaml creases.yaml contour_map.yaml camera.yaml)
	$(call scenes,120,901000,--preset broad --camera $(OUT)/camera.yaml --views 1 --samples 3)
	$(call scenes,100,900000,--camera $(OUT)/camera.yaml --views 1 --samples 3)
	$(call scenes,30,62000,--views 5 --samples 1)
	$(call learn,--views 7 --map)

$(OUT)/views.yaml: $(OUT)/contour_map_evidence.yaml
	$(call scenes,6,81000,$(ARC) --kind glass)
	$(call scenes,6,82100,$(GRID) --kind 'opaque film')
	$(call scenes,40,84000,$(ARC) --kind glass)
	$(call scenes,9,84100,$(GRID) --kind glass)
	$(call scenes,10,84200,$(GRID) --kind 'opaque film')
	$(call scenes,20,84300,$(ARC))
	$(call scenes,150,860000,$(ARC) --kind glass)
	$(call learn,--posed)

# By what: the tree, the packages, the commands with their seeds, the digests of the files. Losses
# are in contour_map.yaml.
$(OUT)/record.txt: $(FILES:%=$(OUT)/%)
	{ git log -1 --format='commit %H'; git status --short; $(PYTHON) -V; $(PYTHON) -m pip freeze; \
		make --no-print-directory -Bnf tools/learned.mk $^; sha256sum $^; } > $@
