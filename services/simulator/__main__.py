"""Run the simulator: `python -m services.simulator`."""

from services.runtime.service import main
from services.simulator.service import Simulator
from services.simulator.settings import SimulatorSettings

if __name__ == "__main__":
    main(SimulatorSettings, "simulator", Simulator)
