"""`python -m services.mapper`."""

from services.mapper.service import MapperService
from services.mapper.settings import MapperSettings
from services.mapper.warm_up import warm_up
from services.runtime.service import main

if __name__ == "__main__":
    main(MapperSettings, "mapper", MapperService, prepare=warm_up)
