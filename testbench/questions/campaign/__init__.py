"""What scatters when the same flight is repeated many times, over distributions of anything in it?

Worker processes fly the runs into one store, which a killed process leaves whole. The answer gives bias, scatter and
the coverage of stated errors, and what failed how often.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, fly_campaign="ask", load_campaign="load", CampaignSpec="scenario", campaign_page="page")
