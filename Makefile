# cabols: `make demo` and `make test` set up what they need and run. Options:
#   PYTHON=/path/to/python3.11   the Python to make .venv with (3.10 to 3.13; default: found)
#   ARGS="..."                   more arguments for demo, commission, test and the benchmarks

# What a sourced ROS workspace leaves in the shell would mix with .venv.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH
unexport PYTHONHOME RMW_IMPLEMENTATION ROS_DISTRO _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Nothing here is meant for other machines on the network.
export ROS_AUTOMATIC_DISCOVERY_RANGE = LOCALHOST
# Matrices here are small: on a busy machine threads for them make a fit thirty times slower.
export OPENBLAS_NUM_THREADS = 1

HOST_PYTHON = $(shell for name in python3 python3.11 python3.12 python3.13 python3.10 "$$PYTHON"; \
	do command -v "$$name" && break; done)
BIN = .venv/bin

.PHONY: $(shell sed -n 's/^\([a-z-]*\):.*/\1/p' Makefile)
.NOTPARALLEL:

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):[^#]*## \(.*\)/\1|\2/p' Makefile | while IFS='|' read -r target text; \
	do printf '  make %-18s %s\n' "$$target" "$$text"; done

demo: setup  ## run the simulated rig and leave its report in build/demo
	@.venv/lib/cabols_sim/demo $(ARGS)

commission: setup  ## commission the simulated rig's limbs and leave models and gains in build/commission
	@.venv/lib/cabols_sim/commission_bench $(ARGS)

workspace: setup  ## map the workspace: table, meshes and figures in build/workspace
	@.venv/lib/cabols_control/workspace map $(ARGS)

workspace-robots: setup  ## map six robots of one file each into build/robots, beside linear programmes; resumes
	@$(BIN)/python tests/bench/check_robots.py $(ARGS)

design-geometry: setup  ## optimise the attachment points into build/design, check them by other means
	@.venv/lib/cabols_control/workspace design $(ARGS)
	@$(BIN)/python tests/bench/check_design.py build/design/geometry.yaml

console: setup  ## serve the operator's page for the simulated rig at http://localhost:8080
	@.venv/lib/cabols_sim/console_bench $(ARGS)

new-rig: setup  ## make the folder of a rig from the bench's: make new-rig ARGS="my_rig --cables 7"
	@.venv/lib/cabols_control/new_rig $(ARGS)

check-rig: setup  ## read a rig's files and say what was read: make check-rig ARGS=my_rig
	@.venv/lib/cabols_sim/check_rig $(ARGS)

browser:  ## find or install the Chromium that the console's tests drive
	@"$(HOST_PYTHON)" tools/setup_browser.py

test: setup browser  ## run the tests: pure ones, graphs two at a time, then those in real time alone
	@$(BIN)/python tools/run_tests.py $(ARGS)

test-long: setup  ## run the tests that take minutes
	@$(BIN)/python -m pytest -m long $(ARGS)

colcon-test: setup browser  ## run each package's tests with colcon test
	@$(BIN)/python tools/colcon_test.py $(ARGS)

test-stress: setup browser  ## run the tests five times beside a busy loop (RUNS=5; goes on where it was)
	@$(BIN)/python tools/stress_tests.py --runs $(or $(RUNS),5) -- $(ARGS)

structure: setup  ## write the tables of rooms and imports in docs/architecture.md
	@$(BIN)/python tools/structure.py --write

interface: setup  ## write docs/interface.md and the picture of the graph from the code
	@$(BIN)/python tools/interface.py --write

figures: setup  ## write docs/figures.md from what the benchmarks left in build
	@$(BIN)/python tools/figures.py $(ARGS)

follow-docs:  ## follow the commands of README and docs from a fresh clone; ARGS=--list, --long
	@"$(HOST_PYTHON)" tools/follow_docs.py $(ARGS)

commands-table: setup  ## run every command wrongly and write docs/commands.md: what each does
	@$(BIN)/python tools/commands_table.py --write

lint: setup  ## check style and types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

format: setup  ## mend style where a tool can
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

bench: bench-tension bench-limb-step bench-methods bench-workspace bench-simulation bench-registration
bench: bench-stiffness bench-design bench-analysis bench-realtime  ## run all benchmarks into build/bench

bench-tension: setup  ## time the tension distribution
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_tension.py $(ARGS)

bench-limb-step: setup  ## time the limb controller's step in each mode
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_limb_step.py $(ARGS)

bench-methods: setup  ## compare the methods of tension distribution
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_methods.py $(ARGS)

bench-continuity: setup  ## changes of tensions between cycles, near the boundary and beyond it
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_continuity.py $(ARGS)

bench-pulleys: setup  ## time a new pose over pulleys beside one between points
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_pulleys.py $(ARGS)

bench-pulley-loop: setup  ## a wrench held on a moving platform over pulleys that control knows or neglects
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_pulley_loop.py $(ARGS)

bench-calibration: setup  ## calibrate 200 simulated rigs that differ from their drawing (--short: 20); resumes
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_calibration.py $(ARGS)

bench-workspace: setup  ## time workspace grids beside linear programmes
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_workspace.py $(ARGS)

bench-pose-faults: setup  ## faults of the pose's sources through the estimator's node, an hour without; resumes
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_pose_faults.py $(ARGS)

bench-pose-estimator: setup  ## an hour of a rig's data without a false alarm, faults named (--short: 5 minutes)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_pose_estimator.py $(ARGS)

bench-forward-kinematics: setup  ## poses of ten public robots from their cables' lengths: none wrong, time; resumes
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_forward_kinematics.py $(ARGS)

bench-simulation: setup  ## time the simulated rig against the wall clock
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_simulation.py $(ARGS)

bench-stiffness: setup  ## identify simulated stiffness campaigns, hundreds of times
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_stiffness.py $(ARGS)

bench-verdict: setup  ## data sets drawn by seed: good ones refused, wrong ones accepted (an hour; ARGS=--short: minutes)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_verdict.py $(ARGS)

bench-ladder: setup  ## ladder of models: coverage of each rung's intervals, time in linear fits (goes on where it was)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_ladder.py $(ARGS)

bench-mismatch: setup  ## ladder of models on hidden robots: held-out deflections, compensation, bands (goes on where it was)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_mismatch.py $(ARGS)

bench-coverage: setup  ## 95 % intervals against the truth, 1000 runs a case (goes on where it was; ARGS=--short: minutes)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_coverage.py $(ARGS)

bench-fit: setup  ## speed of the fit against scipy's least_squares, time and memory of 100 000 samples
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_fit.py $(ARGS)

table-scatter: setup  ## what the scatter of the source's table 4.3 can be: noise alone, joint by joint
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/table_scatter.py $(ARGS)

bench-design: setup  ## count the loads that an optimal stiffness campaign saves
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_design.py $(ARGS)

bench-campaign: setup  ## 20 seeds of a five-configuration campaign: errors, coverage (hours; goes on where it was)
	@$(BIN)/python tests/bench/bench_campaign.py $(ARGS)

campaign-robots: setup  ## a short campaign on each simulated robot controller: RWS 1, RWS 2, RTDE with its own arm
	@$(BIN)/python tests/bench/campaign_robots.py $(ARGS)

bench-tracking: setup  ## errors against the command: feedback and preview, as designed and with a mismatch
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_tracking.py $(ARGS)

bench-tracking-commissioned: setup  ## the same with wrong rigs that were commissioned: k_e and play by their own ramps
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_tracking.py --commissioned --output build/bench/tracking_commissioned.json $(ARGS)

bench-cycle-cost: setup  ## what extrapolated poses, backlash and uncertainty add to a cycle of the controllers
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_cycle_cost.py $(ARGS)

bench-bandwidth: setup  ## bandwidth, margins and currents of each axis, by feedback alone; steps with preview
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_bandwidth.py $(ARGS)

bench-moving: setup  ## a wrench held on a target that moves or shakes, lag known and not: ARGS="--seeds 20"
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_moving.py $(ARGS)

bench-registration: setup  ## compare the reflectors' registration with its covariance
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_registration.py $(ARGS)

bench-robot-stop: setup  ## 300 stops of the robot over a network that loses 30 % of the requests; resumes
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_robot_stop.py $(ARGS)

bench-realtime: setup  ## measure the control loop's delay and jitter at 1 kHz
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_realtime.py $(ARGS)

bench-against: setup  ## run a benchmark in turn with another checkout: BASE=FOLDER ARGS="--bench tension"
	@$(BIN)/python tests/bench/interleave.py $(BASE) $(ARGS)

bench-transport: setup  ## measure what a killed process costs the others, by shared memory and by UDP
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_transport.py $(ARGS)

bench-console: setup  ## measure what the console costs the rig
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_console.py $(ARGS)

faults: setup  ## break everything, in every state (hours; goes on where it was; ARGS=--short: minutes)
	@.venv/lib/cabols_sim/fault_campaign $(ARGS)

bench-heartbeat: setup  ## how long the robot needs to hear of a fault, through the real nodes (goes on where it was)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_heartbeat.py $(ARGS)

bench-restart: setup  ## start the bridge again under loads that the gears hold: is the wrench right?
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_restart.py $(ARGS)

life-cycle: setup  ## start and end the rig 200 times, at any moment, in every way (goes on; ARGS=--short)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/life_cycle.py $(ARGS)

stop-trials: setup  ## press the stop 1000 times, also beside a supervisor's restart (goes on where it was)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/stop_trials.py $(ARGS)

dynamics: setup  ## compute chapter 2, the 900 m case and the rig's vibration into build/dynamics
	@.venv/lib/cabols_sim/dynamics_study $(ARGS)

fast-gains: setup  ## prove the faster control design through the real nodes
	@.venv/lib/cabols_sim/fast_gains $(ARGS)

campaign: setup  ## a stiffness campaign on the simulated rig, and its report, into build/campaign
	@.venv/lib/cabols_sim/campaign_bench $(ARGS)

campaign-kills: setup  ## kill (-9) every node in turn during short campaigns; nothing may be lost
	@.venv/lib/cabols_sim/campaign_kills $(ARGS)

analyze: setup  ## analyse a campaign's folder or a bag: make analyze ARGS=FOLDER
	@.venv/lib/cabols_stiffness/analyze $(or $(ARGS),build/campaign)

bench-analysis: setup  ## memory and time of analysing bags of up to an hour
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_analysis.py $(ARGS)

corpus: setup  ## read files in the forms that others write, and print the table of what is right
	@$(BIN)/python tests/corpus/check.py

bench-one-process: setup  ## both laws in one process against separate processes: round trip (goes on; ARGS=--short)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/bench_one_process.py $(ARGS)

bench-two-hosts: setup  ## one rig on two hosts (network namespaces): delay, loss, errors (needs root; ARGS=--short)
	@mkdir -p build/bench
	@$(BIN)/python tests/bench/two_hosts.py $(ARGS)

rt-check: setup  ## say what this computer's kernel gives a control loop, and what to set
	@.venv/lib/cabols_control/rt_check --output build/bench/rt_check.json $(ARGS)

parameters-file: setup  ## write all parameters of all nodes for params_file:=FILE; ARGS="--output FILE"
	@.venv/lib/cabols_control/parameters_file $(ARGS)

fuzz: setup  ## fuzz every parser and socket for ten minutes; goes on where it was; ARGS="--minutes 1"
	@$(BIN)/python tests/fuzz/fuzz.py $(ARGS)

setup:  ## make .venv and build the workspace into it (done by the others when needed)
	@test -n "$(HOST_PYTHON)" || { echo "setup: no Python found." \
		"Install: sudo apt install python3 python3-venv python3-dev" >&2; exit 1; }
	@"$(HOST_PYTHON)" tools/setup_workspace.py

lock:  ## renew requirements.lock (maintainers; needs Python 3.10 to 3.13)
	@python3 tools/make_lock.py python3.11 python3.12 python3.13 python3.10

clean:  ## remove .venv, build and caches
	@rm -rf .venv build install log .mypy_cache .pytest_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
