"""Texts of the manifest that have a form: what each is called, and how it is written."""

from rarms_iac.model.keys import Form

FORMS: dict[str, tuple[str, str]] = {
    Form.NAME: (
        "a name",
        "Names have 1 to 63 small letters a-z, digits and hyphens, and start and end with a letter or digit.",
    ),
    Form.TASK: (
        "the name of a task class",
        "Task classes have 1 to 63 letters, digits and spaces, and start with a letter.",
    ),
    Form.VARIABLE: (
        "the name of an environment variable",
        "Such names have letters, digits and underscores, and do not start with a digit.",
    ),
    Form.CALL: ("a function", "Write module:function, as in components.path_planning:plan."),
    Form.SSH: ("an address for ssh", "Write user@host, or a name of your ssh configuration."),
    Form.HOST: ("the name of a host", "Write its name or address, as in cell.plant.example."),
    Form.SSH_FILE: ("a file of ssh", "Write its path, without quotes; letters, digits, blanks and ~/._%+:@- fit."),
    Form.ABSOLUTE_FOLDER: ("an absolute path", "Write the whole path on the robot, as in /opt/robot."),
    Form.SLICE: (
        "the name of a control group",
        "Such names have small letters, digits, hyphens and underscores, and start with a letter or digit.",
    ),
    Form.STRESSOR: ("a stressor", "Write a name that stress-ng --stressors shows, as in timer."),
    Form.OPERATION: ("an operation", "Write its kind in small letters and underscores, as in start_partition."),
    Form.LEAST_VERSION: ("a least version", "Write >= and the version, as in '>=0.2'."),
    Form.CODE: ("a finding's id", "Write RARMS and three digits, as in RARMS041."),
    Form.DAY: ("a day", "Write year-month-day, as in 2027-01-31."),
}
