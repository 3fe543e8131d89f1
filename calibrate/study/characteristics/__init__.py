"""Characteristics: the parameters of a model as data sets of control units hold them, in CDFX and DCM files."""

from .base import DERIVED as DERIVED, Characteristic as Characteristic, DataSet as DataSet
from .cdfx import to_cdfx as to_cdfx
from .dcm import to_dcm as to_dcm
from .read import READERS as READERS, read_data_set as read_data_set
