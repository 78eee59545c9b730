"""`python -m services.planner`."""

from services.planner.service import PlannerService
from services.planner.settings import PlannerSettings
from services.planner.warm_up import warm_up
from services.runtime.service import main

if __name__ == "__main__":
    main(PlannerSettings, "planner", PlannerService, prepare=warm_up)
