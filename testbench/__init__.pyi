"""What ``import testbench`` offers, and the types of it; see testbench/__init__.py."""

from testbench.aircraft import Aircraft as Aircraft
from testbench.core.errors import TestbenchError as TestbenchError
from testbench.core.record import FlightRecord as FlightRecord
from testbench.core.record import load_record as load_record
from testbench.estimators import METHODS as METHODS
from testbench.estimators import estimate as estimate
from testbench.estimators.model import IdentifiedModel as IdentifiedModel
from testbench.estimators.parametric.structures.written import structure_from_equations as structure_from_equations
from testbench.evaluation import Evaluation as Evaluation
from testbench.evaluation import TrueSystem as TrueSystem
from testbench.evaluation import evaluate as evaluate
from testbench.flight import (
    FlightCondition as FlightCondition,
)
from testbench.flight import (
    LinearModel as LinearModel,
)
from testbench.flight import (
    Manoeuvre as Manoeuvre,
)
from testbench.flight import (
    Start as Start,
)
from testbench.flight import (
    TrimmedFlight as TrimmedFlight,
)
from testbench.flight import (
    fly as fly,
)
from testbench.flight import (
    load_aircraft as load_aircraft,
)
from testbench.flight.batch.as_jax import JaxAircraft as JaxAircraft
from testbench.flight.batch.as_jax import as_jax as as_jax
from testbench.flight.batch.fly import fly_many as fly_many
from testbench.flight.batch.fly import fly_stream as fly_stream
from testbench.flight.batch.jobs import Job as Job
from testbench.flight.batch.trim import trim_many as trim_many
from testbench.flight.linearise import linearise as linearise
from testbench.flight.tangents import FlightParameter as FlightParameter
from testbench.flight.tangents import Tangents as Tangents
from testbench.flight.tangents import tangents as tangents
from testbench.flight.trim import trim as trim
from testbench.inference.calibrate import Reliability as Reliability
from testbench.inference.calibrate import calibrate as calibrate
from testbench.inference.causes import with_causes as with_causes
from testbench.inference.evidence import Comparison as Comparison
from testbench.inference.evidence import Fitting as Fitting
from testbench.inference.evidence import compare_hypotheses as compare_hypotheses
from testbench.inference.fit import Hypothesis as Hypothesis
from testbench.inference.fit import Posterior as Posterior
from testbench.inference.instruments import Agreement as Agreement
from testbench.inference.instruments import agreement as agreement
from testbench.inference.parameters import Noise as Noise
from testbench.inference.parameters import Parameter as Parameter
from testbench.inference.unknown import pulses as pulses
from testbench.inputs import InputSignal as InputSignal
from testbench.line import Flight as Flight
from testbench.line import fly_and_measure as fly_and_measure
from testbench.logs.manoeuvres import Cutting as Cutting
from testbench.logs.read import read_records as read_records
from testbench.logs.sidpac import Told as Told
from testbench.page.shown import write_results as write_results
from testbench.pooling.least_squares import LogCoefficients as LogCoefficients
from testbench.pooling.pool import Pooled as Pooled
from testbench.pooling.pool import pool as pool
from testbench.pooling.prior import Prior as Prior
from testbench.questions.aircraft.ask import Survey as Survey
from testbench.questions.aircraft.ask import survey as survey
from testbench.questions.campaign.ask import Ending as Ending
from testbench.questions.campaign.ask import fly_campaign as fly_campaign
from testbench.questions.campaign.load import Campaign as Campaign
from testbench.questions.campaign.load import load_campaign as load_campaign
from testbench.questions.compare.ask import compare as compare
from testbench.questions.compare.benchmark.ask import benchmark as benchmark
from testbench.questions.compare.benchmark.result import Benchmark as Benchmark
from testbench.questions.compare.result import CompareResult as CompareResult
from testbench.questions.dataset.ask import Drawn as Drawn
from testbench.questions.dataset.ask import draw_dataset as draw_dataset
from testbench.questions.dataset.open import FlightSamples as FlightSamples
from testbench.questions.dataset.open import open_dataset as open_dataset
from testbench.questions.dataset.open import open_datatree as open_datatree
from testbench.questions.design.ask import run_design as run_design
from testbench.questions.design.known import known_after as known_after
from testbench.questions.design.result import DesignResult as DesignResult
from testbench.questions.export.aircraft import export_aircraft as export_aircraft
from testbench.questions.files import ask as ask
from testbench.questions.files import load as load
from testbench.questions.gap.ask import GapResult as GapResult
from testbench.questions.gap.ask import run_gap as run_gap
from testbench.questions.gap.result import GapFinding as GapFinding
from testbench.questions.gap.workflow import GapSearch as GapSearch
from testbench.questions.gap.workflow import find_gap as find_gap
from testbench.questions.global_model.ask import global_model as global_model
from testbench.questions.global_model.result import GlobalFound as GlobalFound
from testbench.questions.identify.amend.ask import amend as amend
from testbench.questions.identify.amend.result import Amended as Amended
from testbench.questions.identify.ask import identify as identify
from testbench.questions.identify.ask import load_description as load_description
from testbench.questions.identify.pool.ask import (
    PooledFlights as PooledFlights,
)
from testbench.questions.identify.pool.ask import (
    identify_and_pool as identify_and_pool,
)
from testbench.questions.identify.result import Identified as Identified
from testbench.questions.identify.scenario import RecordDescription as RecordDescription
from testbench.questions.importing.ask import Imported as Imported
from testbench.questions.importing.ask import import_log as import_log
from testbench.questions.modes.ask import fly_modes as fly_modes
from testbench.questions.modes.result import ModesResult as ModesResult
from testbench.questions.plan.ask import make_plan as make_plan
from testbench.questions.plan.result import Plan as Plan
from testbench.questions.results.ask import (
    ResultsCompared as ResultsCompared,
)
from testbench.questions.results.ask import (
    ResultSummary as ResultSummary,
)
from testbench.questions.results.ask import Verified as Verified
from testbench.questions.results.ask import (
    compare_results as compare_results,
)
from testbench.questions.results.ask import (
    list_results as list_results,
)
from testbench.questions.results.ask import verify_results as verify_results
from testbench.questions.run.ask import load_scenario as load_scenario
from testbench.questions.run.ask import run as run
from testbench.questions.run.result import RunResult as RunResult
from testbench.questions.run.scenario import Scenario as Scenario
from testbench.questions.tidy import read_results as read_results
from testbench.sensors import SensorSuite as SensorSuite
from testbench.sensors import load_suite as load_suite

__version__: str
__all__: list[str]
