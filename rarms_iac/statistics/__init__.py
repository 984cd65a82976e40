"""What measured samples say, and how surely (docs/measuring.md).

Series of samples and thresholds come in (`model/series`); estimates with bounds, verdicts (`model/outcomes`) and
curves over the reservation go out, each with the probability that it is wrong. Begin with `verdicts.judge`, which asks
`steady_state` where a series is steady and `estimates` for its indexes; `curves.least_reserve` is what every
reservation uses. Pure, standard library only, nothing is drawn at random.
"""
