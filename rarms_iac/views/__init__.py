"""What a person or a program sees: views take finished values, decide nothing and return what is to be written.

Plans, run reports, results of use cases and findings come in; what rich lays out, text or JSON goes out. Begin with
`console` (the pieces of every text, and `render`), `table` (the one form of a table) and with the module of a command:
`plan`, `run`, `measure`, `tune`.
`findings_text` is for people, `finding_forms` for programs. `terminal` writes to a terminal or pipe without ever
breaking a command. `json_output` writes a result as JSON; `reports` is the report in all its forms. JSON, SARIF and
JUnit need no rich.
"""
