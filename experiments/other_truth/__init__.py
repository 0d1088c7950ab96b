"""A truth by another hand: braking recordings with concealed effects, made without anything of wsp_env."""
