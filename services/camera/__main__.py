"""`python -m services.camera`."""

from services.camera.service import CameraService
from services.camera.settings import CameraSettings
from services.camera.warm_up import warm_up
from services.runtime.service import main

if __name__ == "__main__":
    warm_up()  # Takes a moment: before the bus knows us, and the simulator waits for us.
    main(CameraSettings, "camera", CameraService)
