"""How do results scatter when the same flight is repeated many times, with distributions of any of its values?

Worker processes fly the runs into one store, which survives a killed process. The answer gives bias, scatter and the
coverage of stated errors, and the rate of failures with their causes.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, fly_campaign="ask", load_campaign="load", CampaignSpec="scenario", campaign_page="page")
