"""The part that runs inside MuJoCo's step: struct layout, the servo's row of userdata, the tick, the hook."""
