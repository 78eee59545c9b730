"""`python -m services.evaluator`."""

from services.evaluator.service import EvaluatorService
from services.evaluator.settings import EvaluatorSettings
from services.runtime.service import main

if __name__ == "__main__":
    main(EvaluatorSettings, "evaluator", EvaluatorService)
