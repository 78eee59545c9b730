"""`python -m services.evaluator`."""

from contextlib import suppress

from services.evaluator.open3d_loader import open3d
from services.evaluator.service import EvaluatorService
from services.evaluator.settings import EvaluatorSettings
from services.runtime.errors import MissingExtra
from services.runtime.service import main

if __name__ == "__main__":
    with suppress(MissingExtra):  # The service says it again, where it is reported.
        open3d()  # Takes a second: before the bus knows us, and the simulator waits for us.
    main(EvaluatorSettings, "evaluator", EvaluatorService)
