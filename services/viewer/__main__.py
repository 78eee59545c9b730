"""`python -m services.viewer`."""

from services.runtime.service import main
from services.viewer.service import ViewerService, give_way
from services.viewer.settings import ViewerSettings

if __name__ == "__main__":
    main(ViewerSettings, "viewer", ViewerService, prepare=give_way)
