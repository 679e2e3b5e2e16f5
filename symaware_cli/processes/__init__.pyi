# What other rooms use of this one.

from .distribution_error import DistributionError as DistributionError
from .merging import Merged as Merged
from .merging import merge as merge
from .place import Place as Place
from .process_log import ProcessLog as ProcessLog
from .process_log import missing_in_words as missing_in_words
from .process_log import open_process_logs as open_process_logs
from .transport import Port as Port
from .transport import PortEvent as PortEvent
from .transport import Transport as Transport
from .transport import TransportError as TransportError
from .transport import TransportParameters as TransportParameters
