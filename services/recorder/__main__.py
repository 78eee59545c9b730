"""`python -m services.recorder`."""

from services.recorder.record import main

if __name__ == "__main__":
    main()
