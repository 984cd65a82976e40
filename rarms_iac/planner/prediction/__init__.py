"""What a compound will probably need, from what is known of its members: chooses questions, and proves nothing.

Data logs of components measured alone come in; the reservation that a compound probably needs goes out. Begin with
`members.predictor_of`; `periodic` has the model behind it.
"""
