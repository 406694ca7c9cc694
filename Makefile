# The everyday commands of CarMap. `make` alone lists them.
JOBS ?= $(shell nproc)
FUZZ_SECONDS ?= 60
export CMAKE_BUILD_PARALLEL_LEVEL := $(JOBS)

.DEFAULT_GOAL := help
.PHONY: help setup build demo test bench evaluate evaluate-localization evaluate-slam evaluate-stitching evaluate-diffs \
  evaluate-forgetting signature vocabulary segmenter lint format asan tsan fuzz clean

help:  ## list these commands
	@echo 'make COMMAND [JOBS=N]      (N processes at once; default: one a core)'
	@echo
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 30
	@echo
	@echo 'On a bare Debian 12: `make demo` or `make test`; each does all of the set-up itself.'
	@echo 'Real drives are looked for in $$CARMAP_DATA, or else in ../shared/data.'

setup:  ## install the Debian packages that are missing
	@scripts/install_dependencies.sh build

build: setup  ## the optimised program alone: build/release/bin/carmap
	@cmake --preset release
	@cmake --build --preset release --target carmap

demo: build  ## simulate two drives, map, stitch and localize; report in demo/
	@scripts/demo.sh

test: setup  ## build everything, then run all tests
	@cmake --preset release
	@cmake --build --preset release
	@ctest --preset release

bench: setup  ## time what is hot, as ratios to a yardstick
	@scripts/bench.sh

evaluate: build  ## errors and sizes on every real drive that is present
	@scripts/evaluate.sh

evaluate-localization: build  ## localization by traffic, lane and light, simulated [ALL=1]
	@scripts/evaluate_localization.sh

evaluate-stitching: build  ## stitching beside the ways of the paper's peers, simulated [EXPERIMENTS="lanes overlap"]
	@scripts/evaluate_stitching.sh $(EXPERIMENTS)
evaluate-diffs: build  ## what a vehicle sends of a known road, beside a segment, simulated [SCENES="suburb freeway"]
	@scripts/evaluate_diffs.sh $(SCENES)
evaluate-forgetting: build  ## what a base learns and forgets of streets that change, simulated [SCENES="suburb downtown"]
	@scripts/evaluate_forgetting.sh $(SCENES)

evaluate-slam: build  ## loops and errors of drives simulated along KITTI paths [PATHS="07 06"]
	@scripts/evaluate_slam.sh $(PATHS)

signature: setup  ## choose the comparisons of the features' signature anew, of simulated drives
	@cmake --preset release
	@scripts/train_signature.sh

vocabulary: build  ## make the program's default vocabulary anew, of simulated drives
	@scripts/train_vocabulary.sh

segmenter: build  ## make the program's default segmentation network anew, of simulated drives
	@scripts/install_dependencies.sh segmenter
	@scripts/train_segmenter.sh

lint:  ## formatting, shell scripts, clang-tidy over what differs from main [ALL=1]
	@scripts/install_dependencies.sh lint
	@scripts/lint.sh $(if $(ALL),--all)

format:  ## format all C++ sources
	@scripts/install_dependencies.sh style
	@find src tests bench fuzz -name '*.h' -o -name '*.cc' | xargs clang-format -i

asan: setup  ## build and test under address and undefined-behaviour sanitizers
	@cmake --preset asan
	@cmake --build --preset asan
	@ctest --preset asan

tsan: setup  ## build and test under the thread sanitizer
	@cmake --preset tsan
	@cmake --build --preset tsan
	@ctest --preset tsan

fuzz:  ## feed each fuzzer for FUZZ_SECONDS (default 60)
	@scripts/install_dependencies.sh fuzz
	@scripts/fuzz.sh $(FUZZ_SECONDS)

clean:  ## remove what was built and the demo's results
	@rm -rf build demo
