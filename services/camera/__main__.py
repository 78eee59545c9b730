"""`python -m services.camera`."""

from services.camera.service import CameraService
from services.camera.settings import CameraSettings
from services.camera.warm_up import warm_up
from services.runtime.service import main

if __name__ == "__main__":
    main(CameraSettings, "camera", CameraService, prepare=warm_up)
