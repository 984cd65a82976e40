"""What a compound will probably need, from what is known of its members: guides questions, and proves nothing.

Data logs of components measured alone come in, and the answers so far; the reservation that a compound probably needs
goes out, as a distribution over per cents. Begin with `members.predictor_of` and `members.expected_of`. `periodic` has
the models behind it, processor sharing and the periodic resource; `belief` weighs the ways to predict by the answers.
"""
